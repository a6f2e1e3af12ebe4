/* Camera presets: each looks along a direction and frames a box, whatever its size. */

/** World coordinates (z up) as three.js sees meshcat's scene (y up). */
const yUp = (p) => new MeshCat.THREE.Vector3(p[0], p[2], -p[1]);

/** The eight corners of a box given by two opposite ones. */
function corners(box) {
  const points = [];
  for (let i = 0; i < 8; i++)
    points.push(yUp([box[i & 1][0], box[(i >> 1) & 1][1], box[(i >> 2) & 1][2]]));
  return points;
}

/**
 * Target and distance from which all points lie inside the free part of the window.
 * The extent seen from the target is balanced, then measured again.
 */
function frame(points, direction, tanX, tanY) {
  const T = MeshCat.THREE, up = new T.Vector3(0, 1, 0);
  const right = new T.Vector3().crossVectors(up, direction).normalize();
  const above = new T.Vector3().crossVectors(direction, right);
  const target = points.reduce((sum, p) => sum.add(p), new T.Vector3()).divideScalar(points.length);
  const offset = new T.Vector3();
  let distance = 0;
  for (let round = 0; round < 8; round++) {
    distance = 0;
    for (const p of points) {
      offset.subVectors(p, target);
      const wide = Math.abs(offset.dot(right)) / tanX, high = Math.abs(offset.dot(above)) / tanY;
      distance = Math.max(distance, offset.dot(direction) + Math.max(wide, high));
    }
    for (const axis of [right, above]) {
      const seen = points.map((p) => {
        offset.subVectors(p, target);
        return offset.dot(axis) / (distance - offset.dot(direction));
      });
      target.addScaledVector(axis, distance * (Math.max(...seen) + Math.min(...seen)) / 2);
    }
  }
  return { target, distance: 1.04 * distance };
}

/** Part of the window that the panels leave free: insets in pixels. */
function freeInsets() {
  const size = (id) => document.getElementById(id).getBoundingClientRect();
  const wide = innerWidth >= 900;
  return {
    left: innerWidth >= 1200 ? size("head").width + 24 : 12, right: wide ? size("legend").width + 24 : 12,
    top: wide ? 12 : size("head").height + 24, bottom: size("foot").height + 24,
  };
}

/** Put the camera where a preset wants it; `box` holds two corners, in meters. */
function placeCamera(viewer, preset, box, cell) {
  const T = MeshCat.THREE, camera = viewer.camera, inset = freeInsets();
  const width = innerWidth, height = innerHeight;
  const freeX = Math.max(0.3, 1 - (inset.left + inset.right) / width);
  const freeY = Math.max(0.3, 1 - (inset.top + inset.bottom) / height);
  const tan = Math.tan((preset.fov / 2) * (Math.PI / 180));
  const direction = yUp(preset.direction).normalize();
  const { target, distance } = frame(corners(box), direction, (tan * freeX * width) / height, tan * freeY);
  const size = yUp(cell[0]).distanceTo(yUp(cell[1]));
  // Presets move the camera and the target it orbits; its node stays where it is.
  viewer.scene_tree.find(["Cameras", "default"]).object.position.set(0, 0, 0);
  viewer.controls.target.copy(target);
  camera.position.copy(target).addScaledVector(direction, distance);
  camera.fov = preset.fov;
  camera.zoom = 1;
  camera.near = Math.max(0.01 * size, distance - 4 * size);
  camera.far = distance + 8 * size;
  const x = (inset.right - inset.left) / 2, y = (inset.bottom - inset.top) / 2;
  camera.setViewOffset(width, height, x, y, width, height);
  viewer.controls.update();
  viewer.set_dirty();
}
