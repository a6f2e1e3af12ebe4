"""The drape tool as URDF and sidecar, and their generator."""
