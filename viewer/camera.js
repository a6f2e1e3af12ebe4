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

/** Part of a pane that the panels over it leave free: insets in pixels. */
function freeInsets(pane, head) {
  const room = pane.getBoundingClientRect(), free = { left: 12, right: 12, top: 12, bottom: 12 };
  const over = (panel) => {
    const box = panel.getBoundingClientRect();
    return box.width && box.left < room.right && box.right > room.left && box.top < room.bottom && box.bottom > room.top ? box : null;
  };
  const side = over(byId("side")), foot = over(byId("foot")), title = over(head);
  if (side) free.right += room.right - side.left;
  if (foot) free.bottom += room.bottom - foot.top;
  if (title && room.width >= 1000) free.left += title.right - room.left;
  else if (title && room.width < 700) free.top += Math.min(0.25 * room.height, title.bottom - room.top);
  return free;
}

/** Put the camera of a drape where a preset wants it. */
function placeCamera(drape, preset) {
  const T = MeshCat.THREE, { viewer, plan } = drape, { pane, head } = drape.dom, { camera } = viewer;
  const width = Math.max(1, pane.clientWidth), height = Math.max(1, pane.clientHeight), inset = freeInsets(pane, head);
  const freeX = Math.max(0.3, 1 - (inset.left + inset.right) / width);
  const freeY = Math.max(0.3, 1 - (inset.top + inset.bottom) / height);
  const tan = Math.tan((preset.fov / 2) * (Math.PI / 180));
  const direction = yUp(preset.direction).normalize();
  const { target, distance } = frame(corners(plan.boxes[preset.box]), direction, (tan * freeX * width) / height, tan * freeY);
  const size = yUp(plan.boxes.cell[0]).distanceTo(yUp(plan.boxes.cell[1]));
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
  drape.home = { target: target.clone(), distance, size };
  viewer.controls.update();
  viewer.set_dirty();
}

/** Let one camera look at its drape as another looks at its own, whatever their sizes. */
function followCamera(leader, follower) {
  const from = leader.viewer, to = follower.viewer, scale = follower.home.distance / leader.home.distance;
  const shifted = from.controls.target.clone().sub(leader.home.target).multiplyScalar(scale);
  to.controls.target.copy(follower.home.target).add(shifted);
  to.camera.position.copy(from.camera.position).sub(from.controls.target).multiplyScalar(scale).add(to.controls.target);
  to.controls.update();
  to.set_dirty();
}

/** Bring a point of the world, z up, into the middle, from the same side and near. */
function approach(drape, point) {
  const { viewer, home } = drape, { camera, controls } = viewer, target = yUp(point);
  const direction = camera.position.clone().sub(controls.target).normalize();
  controls.target.copy(target);
  camera.position.copy(target).addScaledVector(direction, 0.5 * home.distance);
  camera.near = 0.02 * home.distance;
  controls.update();
  viewer.set_dirty();
}
