"""config.yaml and the descriptions of rigs: read, validated, and refused in sentences."""
