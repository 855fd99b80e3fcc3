"""Reading and writing files: rig.yaml, text, archives, units; writes are atomic."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "atomic": ["atomic_path", "remove_leftovers", "whole_folder"],
        "rig_yaml": ["load_rig"],
        "world_file": ["load_world"],
        "write_rig": ["save_rig"],
    },
)
