"""The procedure language: YAML to a flat plan of steps."""
