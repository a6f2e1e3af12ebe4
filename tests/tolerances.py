"""Tolerances of the planner's tests: each with its unit and its reason."""

EXACT = 1e-12  # [m, rad] float64 roundings at meter scale
LINK = 1e-9  # [m] links of planning's nets: 1e-6 mm
CLOSED = 1e-6  # [m] interlinks of a plan: 1e-3 mm
LANDED = 1e-4  # [m] placed cups from their targets: 0.1 mm
ALIGNED = 0.1  # [deg] placed cups from their targets
GRADIENT = 1e-7  # [-] central differences with steps of 1e-6
