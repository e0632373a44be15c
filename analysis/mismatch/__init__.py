"""One engine that finds what physics a rig lacks to have made its recordings; see docs/architecture.md."""
