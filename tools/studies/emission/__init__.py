"""Error against run time: this project's methods and tuned peers on twelve known emissions."""
