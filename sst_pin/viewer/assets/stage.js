"use strict";
// The picture: light, floor, camera, layers and words around Meshcat's scene.
const at = (id) => document.getElementById(id);
const escaped = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
const breakable = (html) => html.replace(/_/g, "_<wbr>"); // long names break behind underscores first
const subscript = (name) => name.replace(/^tau/, "\u03c4").replace(/_(\d+|[A-Za-z])$/, "<sub>$1</sub>");

const stage = (() => {
  const THREE = MeshCat.THREE, pane = at("pane");
  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    pane.innerHTML = "<p>This browser has no WebGL, which draws the robot: switch on hardware acceleration, or take another browser.</p>";
    throw error;
  }
  window.viewer = viewer;
  viewer.gui.domElement.style.display = "none"; // the page's controls stand for it
  viewer.set_property(["Background"], "visible", false); // the page's shines through
  const sized = viewer.set_3d_pane_size.bind(viewer); // Meshcat calls it at its first frame, for the whole window's height
  viewer.set_3d_pane_size = () => sized(pane.clientWidth, pane.clientHeight);
  viewer.camera.fov = 24;
  viewer.controls.minPolarAngle = 1e-4; // else a view from above has no right and left

  // Where the camera stands, seen from the robot: x, y, z of the base.
  const VIEWS = { front: [0, -1, 0], side: [1, 0, 0], top: [0, -1e-4, 1], iso: [1, 0.7, 0.6] };
  const up = ([x, y, z]) => new THREE.Vector3(x, z, -y); // three.js has y up
  const MARGIN = 0.9; // of the picture, that the robot fills
  let reach = [], face = null, ground = null, size = 1, view = null, labels = [];

  // --- light and floor, in base axes ---------------------------------------------------------

  const key = new THREE.DirectionalLight(0xffffff, 0.5), fill = new THREE.DirectionalLight(0xffffff, 0.25);
  const shadow = new THREE.Mesh(new THREE.CircleGeometry(1, 64), new THREE.ShadowMaterial({ opacity: 0.16 }));
  const grid = new THREE.GridHelper(1, 12, 0x8a9199, 0x8a9199), floor = new THREE.Group();
  grid.rotateX(Math.PI / 2);
  Object.assign(grid.material, { transparent: true, opacity: 0.28, depthWrite: false });
  shadow.receiveShadow = key.castShadow = true;
  key.shadow.mapSize.set(1024, 1024);
  floor.add(shadow, grid);
  viewer.scene.add(new THREE.AmbientLight(0xffffff, 0.6), key, key.target, fill, fill.target, floor);

  function illuminate() {
    const box = new THREE.Box3().setFromPoints(reach.map(([x, y, z]) => new THREE.Vector3(x, y, z)));
    const middle = box.getCenter(new THREE.Vector3());
    size = box.getSize(new THREE.Vector3()).length() || 1;
    for (const [light, x, y, z] of [[key, 0.3, -0.2, 2], [fill, -1, -1, 0.5]]) {
      light.target.position.copy(middle);
      light.position.set(x, y, z).multiplyScalar(size).add(middle);
    }
    Object.assign(key.shadow.camera, { left: -size, right: size, top: size, bottom: -size, near: 0.1 * size, far: 6 * size });
    key.shadow.camera.updateProjectionMatrix();
    key.shadow.normalBias = 0.004 * size;
    const power = 10 ** Math.floor(Math.log10(size / 4));
    const cell = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= size / 6);
    floor.position.set(Math.round(middle.x / cell) * cell, Math.round(middle.y / cell) * cell, ground === null ? box.min.z - 0.01 * size : ground - 1e-3 * size);
    grid.scale.set(12 * cell, 1, 12 * cell);
    shadow.scale.setScalar(6 * cell);
    shadow.position.z = -1e-3 * size;
    Object.assign(viewer.camera, { near: size / 100, far: 60 * size });
    Object.assign(viewer.controls, { minDistance: size / 20, maxDistance: 25 * size });
  }

  // --- camera --------------------------------------------------------------------------------

  function usual() { // of a planar robot its face, of a flat one too, a little from the side
    if (face) return face;
    const [x, y, z] = [0, 1, 2].map((i) => Math.max(...reach.map((p) => p[i])) - Math.min(...reach.map((p) => p[i])));
    const flat = 0.25 * Math.max(x, y, z);
    return z < flat ? [0.25, -0.6, 1.2] : y < flat ? [0.3, -1, 0.25] : x < flat ? [1, 0.3, 0.25] : VIEWS.iso;
  }

  // As near as the robot's farthest points stay inside the picture, upright or across.
  function frame() {
    if (!reach.length || !pane.clientHeight) return;
    const away = up(view === "usual" ? usual() : VIEWS[view]).normalize(), ahead = away.clone().negate();
    const right = ahead.clone().cross(new THREE.Vector3(0, 1, 0)).normalize(), top = right.clone().cross(ahead);
    const tangent = MARGIN * Math.tan(viewer.camera.fov * Math.PI / 360);
    const points = reach.map(up), depths = points.map((p) => p.dot(ahead));
    const [across, upright] = [[right, tangent * pane.clientWidth / pane.clientHeight], [top, tangent]].map(([axis, slope]) => {
      const [low, high] = [-1, 1].map((sign) => Math.max(...points.map((p, i) => sign * p.dot(axis) - slope * depths[i])));
      return { middle: (high - low) / 2, depth: -(low + high) / (2 * slope) };
    });
    const place = (depth) => right.clone().multiplyScalar(across.middle)
      .addScaledVector(top, upright.middle).addScaledVector(ahead, depth);
    viewer.camera.position.copy(place(Math.min(across.depth, upright.depth)));
    viewer.controls.target.copy(place((Math.min(...depths) + Math.max(...depths)) / 2));
    viewer.controls.update();
    viewer.set_dirty();
  }

  function look(name) {
    view = name;
    frame();
    placeLabels();
  }

  function inside() { // whether all of the robot is in the picture
    viewer.camera.updateMatrixWorld();
    return reach.every((p) => {
      const { x, y, z } = up(p).project(viewer.camera);
      return Math.max(Math.abs(x), Math.abs(y), Math.abs(z)) <= 1;
    });
  }

  viewer.controls.addEventListener("start", () => { view = null; }); // now it is the reader's

  function resize() {
    viewer.set_3d_pane_size();
    if (view) frame();
    placeLabels();
  }

  // --- layers and words ----------------------------------------------------------------------

  const node = (...path) => viewer.scene_tree.find(["meshcat", "robot", ...path]).object;

  function showLayer(name, on) {
    if (name === "floor") floor.visible = on;
    else for (const mover of node().children) {
      const layer = mover.children.find((child) => child.name === name);
      if (layer) layer.visible = on;
    }
    for (const { element, layer } of labels) if (layer === name) element.dataset.on = on;
    viewer.set_dirty();
    placeLabels();
  }

  function showThrough() { // what bodies hide of the arrows, faintly
    const arrows = [];
    for (const mover of node().children) {
      for (const layer of mover.children.filter((child) => ["torques", "reactions"].includes(child.name))) layer.traverse((object) => { if (object.isMesh && !object.children.length && object.material.depthTest) arrows.push(object); });
    }
    for (const arrow of arrows) {
      const seen = new THREE.Mesh(arrow.geometry, arrow.material.clone());
      Object.assign(seen.material, { depthTest: false, transparent: true, opacity: 0.4 });
      seen.renderOrder = 1;
      arrow.add(seen);
    }
  }

  // --- the hand ------------------------------------------------------------------------------

  const caster = new THREE.Raycaster(), TOUCHED = ["bodies", "skeleton", "inertia"];

  function aim(clientX, clientY) {
    const { left, top, width, height } = pane.getBoundingClientRect();
    viewer.camera.updateMatrixWorld();
    caster.setFromCamera(new THREE.Vector2((clientX - left) / width * 2 - 1, 1 - (clientY - top) / height * 2), viewer.camera);
  }
  const inBase = (vector) => viewer.scene.worldToLocal(vector.clone()).toArray();

  // What is seen at a place of the window: its mover, the point and the ray, base axes.
  function hit(clientX, clientY) {
    aim(clientX, clientY);
    const layers = node().children.flatMap((mover) => mover.children.filter(({ name, visible }) => visible && TOUCHED.includes(name)));
    const [first] = caster.intersectObjects(layers, true);
    if (!first) return null;
    let object = first.object;
    while (object.parent !== node()) object = object.parent;
    const base = inBase(caster.ray.origin);
    return { mover: object.name, point: inBase(first.point), ray: inBase(caster.ray.origin.clone().add(caster.ray.direction)).map((x, i) => x - base[i]) };
  }

  function inPlane(clientX, clientY, point) { // through a point, parallel to the picture
    aim(clientX, clientY);
    const through = viewer.scene.localToWorld(new THREE.Vector3(...point)), normal = viewer.camera.getWorldDirection(new THREE.Vector3());
    const found = caster.ray.intersectPlane(new THREE.Plane().setFromNormalAndCoplanarPoint(normal, through), new THREE.Vector3());
    return found ? inBase(found) : point;
  }

  function placeLabels() {
    for (const { element, mover, point } of labels) {
      const object = node(mover);
      object.updateWorldMatrix(true, false);
      viewer.camera.updateMatrixWorld();
      const p = new THREE.Vector3(...point).applyMatrix4(object.matrixWorld).project(viewer.camera);
      element.hidden = element.dataset.on !== "true" || p.z > 1;
      const x = (p.x + 1) / 2 * pane.clientWidth, y = (1 - p.y) / 2 * pane.clientHeight;
      element.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%)`;
    }
  }

  function load(data) {
    reach = data.reach;
    face = data.face;
    ground = data.ground;
    illuminate();
    at("labels").replaceChildren();
    labels = data.labels.map((label) => {
      const element = document.createElement("span");
      element.innerHTML = subscript(label.text.replace(/[&<]/g, ""));
      element.style.color = label.colour;
      at("labels").append(element);
      return { ...label, element };
    });
    showThrough();
    node().children.find(({ name }) => name === "ghost")?.traverse((object) => { object.castShadow = false; });
    for (const [name, on] of Object.entries(data.layers)) showLayer(name, on);
    viewer.camera.updateProjectionMatrix();
    if (viewer.first === undefined || !inside()) view ??= "usual";
    viewer.first = false;
    resize();
  }

  return {
    load, look, resize, placeLabels, showLayer, inside, hit, inPlane,
    place(path, matrix) {
      const { object } = viewer.scene_tree.find(["meshcat", "robot", ...path]);
      matrix.decompose(object.position, object.quaternion, object.scale);
      viewer.set_dirty();
    },
    command(bytes) {
      viewer.handle_command_bytearray(bytes);
      if (viewer.animator.playing) viewer.animator.pause();
    },
    seek(time, indices) { // and how much of the trail has been passed
      viewer.animator.seek(time);
      node("0", "trail").traverse((object) => {
        if (object.isMesh && object.parent.name === "passed") object.geometry.setDrawRange(0, indices);
      });
      viewer.set_dirty();
    },
  };
})();
