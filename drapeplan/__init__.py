"""drapeplan: plans the robotic draping of a prepreg ply, end to end."""

__version__ = "0.1.0"
