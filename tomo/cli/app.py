"""The verbs of ``flametomo``, each a module that is imported when its verb is used."""

from __future__ import annotations

from importlib import import_module
from textwrap import indent
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from tomo.cli.console import UsageError, end

VERBS = {
    "demo": "Simulate a turbulent flame, reconstruct it, and write the report.",
    "simulate": "Simulate the images that a rig's cameras take of a phantom.",
    "init": "Write scan.yaml and rig.yaml for the images in a folder.",
    "reconstruct": "Reconstruct the emission in every voxel from a scan's images.",
    "hull": "Find the voxels of an opaque thing that no silhouette excludes.",
    "export": "Write the frames of a store for other programs, or their statistics.",
    "view": "Show a volume with its cameras, a film or a rig in the browser.",
    "visualize-rig": "Draw a rig's cameras and the volume that they look at.",
    "visualize-volume": "Draw a volume's light, its middle planes or its surfaces.",
    "compare": "Compare two volumes: figures, slices beside each other and their difference.",
    "calibrate-rig": "Calibrate a rig from images of a flat target.",
    "check-rig": "Check whether a rig is good enough for a volume.",
    "convert-rig": "Convert a rig from one format into another.",
}
"""The first sentence of each verb's help, listed without importing the verb."""


class Verbs(TyperGroup):
    """The group of all verbs."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the verbs in the order of their use."""
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import a verb and return its command."""
        if cmd_name not in VERBS:
            return None
        from tomo.cli.declared import command_line

        name = cmd_name.replace("-", "_")
        module = import_module(f"tomo.cli.{name}")
        examples = indent(module.EXAMPLES.strip(), "  ")
        app = command_line(
            getattr(module, name),
            cmd_name,
            help=getattr(module, "DETAILS", ""),
            epilog=f"\b\nExamples:\n{examples}",
            first=getattr(module, "FIRST", ()),
        )
        return typer.main.get_command(app)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """List the verbs with one line each."""
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))

    def make_context(
        self, info_name: str | None, args: list[str], *rest: Any, **extra: Any
    ) -> Any:
        """Return the context of the arguments before the verb; an error is one line."""
        try:
            return super().make_context(info_name, args, *rest, **extra)
        except UsageError as error:
            end(f"error: {error.format_message().rstrip('.')}; see flametomo --help", 2)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb's command; an unknown verb is one line."""
        if args[0] not in VERBS:
            from rigs.files.text import expected_one_of

            end(f"error: verb: found {args[0]!r}, {expected_one_of(args[0], VERBS)}", 2)
        return super().resolve_command(ctx, args)


app = typer.Typer(
    name="flametomo",
    cls=Verbs,
    add_completion=False,
    rich_markup_mode=None,
    subcommand_metavar="VERB ...",
    epilog="flametomo VERB --help explains a verb and its options.",
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        from importlib.metadata import version

        typer.echo(f"flametomo {version('flametomo')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def flametomo(
    ctx: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version."
        ),
    ] = False,
) -> None:
    """Reconstruct the 3-D emission of flames, jets and plumes from calibrated cameras."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())
