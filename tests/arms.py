"""An arm that is no UR: other axes, other offsets, boxes for links."""

JOINTS = (  # name, origin, axis, limit either way in [rad]
    ("a1", "0 0 0.15", "0 0 1", 2.9),
    ("a2", "0.05 0 0.20", "0 1 0", 2.2),
    ("a3", "0 0 0.55", "0 1 0", 2.8),
    ("a4", "0.12 0 0", "1 0 0", 3.1),
    ("a5", "0.42 0 0", "0 1 0", 2.1),
    ("a6", "0.09 0 0", "1 0 0", 6.0),
)
BOXES = (  # size and center of the link that each joint moves, the base first
    ("0.2 0.2 0.14", "0 0 0.07"),
    ("0.16 0.16 0.14", "0 0 0.07"),
    ("0.12 0.12 0.5", "0 0 0.26"),
    ("0.12 0.12 0.12", "0 0 0"),
    ("0.3 0.1 0.1", "0.2 0 0"),
    ("0.08 0.08 0.08", "0 0 0"),
    ("0.03 0.07 0.07", "0.01 0 0"),
)


def six_axes(geometry=True):
    """URDF of the arm, with or without boxes."""
    links = ["base_link", *(f"l{k}" for k in range(1, 7))]
    lines = ['<robot name="six_axes"><link name="tool0"/>']
    for link, (size, center) in zip(links, BOXES, strict=True):
        box = f'<origin xyz="{center}"/><geometry><box size="{size}"/></geometry>'
        box = f"<collision>{box}</collision>" if geometry else ""
        lines.append(f'<link name="{link}">{box}</link>')
    for k, (name, origin, axis, limit) in enumerate(JOINTS):
        lines.append(
            f'<joint name="{name}" type="revolute"><parent link="{links[k]}"/>'
            f'<child link="{links[k + 1]}"/><origin xyz="{origin}"/>'
            f'<axis xyz="{axis}"/><limit lower="-{limit}" upper="{limit}" effort="1" '
            'velocity="2"/></joint>'
        )
    lines.append(
        '<joint name="flange" type="fixed"><parent link="l6"/><child link="tool0"/>'
        '<origin xyz="0.03 0 0" rpy="0 1.5707963267948966 0"/></joint></robot>'
    )
    return "\n".join(lines)
