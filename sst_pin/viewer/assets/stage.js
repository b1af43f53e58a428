"use strict";
// The picture: light, floor, camera, layers and labels around Meshcat's scene, and what a pointer
// hits. The axes of the base have z up, those of three.js y. Meshcat turns its scene to z up; the
// camera is in the axes of three.js.
const at = (id) => document.getElementById(id);
const escaped = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
// Long names may break after underscores.
const breakable = (html) => html.replace(/_/g, "_<wbr>");
// tau_1 as a Greek letter with an index.
const subscript = (name) =>
  name.replace(/^tau/, "\u03c4").replace(/_(\d+|[A-Za-z])$/, "<sub>$1</sub>");

const stage = (() => {
  const THREE = MeshCat.THREE, pane = at("pane");
  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    pane.innerHTML = "<p>This browser has no WebGL, which draws the robot: " +
      "switch on hardware acceleration, or take another browser.</p>";
    throw error;
  }
  window.viewer = viewer;
  viewer.gui.domElement.style.display = "none"; // the page has controls of its own
  viewer.set_property(["Background"], "visible", false); // the page has a background of its own
  // At its first frame Meshcat calls this function with the height of the window.
  const setSize = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = () => setSize(pane.clientWidth, pane.clientHeight);
  viewer.camera.fov = 24;
  viewer.controls.minPolarAngle = 1e-4; // else a view from above has no right and left

  // Where the camera stands, seen from the robot: x, y, z of the base.
  const VIEWS = { front: [0, -1, 0], side: [1, 0, 0], top: [0, -1e-4, 1], iso: [1, 0.7, 0.6] };
  const up = ([x, y, z]) => new THREE.Vector3(x, z, -y); // three.js has y up
  const FILLED = 0.9; // part of the picture that the robot fills
  let reach = []; // points that the robot reaches in the motion, base axes
  let face = null; // direction from which a planar robot is seen
  let ground = null; // height of the floor; null below the robot
  let size = 1; // diagonal of the box around the reach
  let view = null; // name of the view, null if the reader has turned it
  let labels = []; // words at points of bodies, with their elements
  let isFirst = true; // whether no data were loaded yet

  // --- light and floor, in base axes ---------------------------------------------------------

  const key = new THREE.DirectionalLight(0xffffff, 0.5);
  const fill = new THREE.DirectionalLight(0xffffff, 0.25);
  const shadow = new THREE.Mesh(
    new THREE.CircleGeometry(1, 64), new THREE.ShadowMaterial({ opacity: 0.16 }),
  );
  const CELLS = 12; // of the floor's grid, along each side
  const grid = new THREE.GridHelper(1, CELLS, 0x8a9199, 0x8a9199), floor = new THREE.Group();
  grid.rotateX(Math.PI / 2);
  Object.assign(grid.material, { transparent: true, opacity: 0.28, depthWrite: false });
  shadow.receiveShadow = key.castShadow = true;
  key.shadow.mapSize.set(1024, 1024);
  floor.add(shadow, grid);
  const ambient = new THREE.AmbientLight(0xffffff, 0.6);
  viewer.scene.add(ambient, key, key.target, fill, fill.target, floor);

  // Set light, floor and the range of the camera for the size of the robot.
  function illuminate() {
    const points = reach.map(([x, y, z]) => new THREE.Vector3(x, y, z));
    const box = new THREE.Box3().setFromPoints(points);
    const middle = box.getCenter(new THREE.Vector3());
    size = box.getSize(new THREE.Vector3()).length() || 1;
    for (const [light, x, y, z] of [[key, 0.3, -0.2, 2], [fill, -1, -1, 0.5]]) {
      light.target.position.copy(middle);
      light.position.set(x, y, z).multiplyScalar(size).add(middle);
    }
    Object.assign(key.shadow.camera, {
      left: -size, right: size, top: size, bottom: -size, near: 0.1 * size, far: 6 * size,
    });
    key.shadow.camera.updateProjectionMatrix();
    key.shadow.normalBias = 0.004 * size;
    // A cell is a round length; grid lines pass through the origin of the base.
    const power = 10 ** Math.floor(Math.log10(size / 4));
    const cell = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= size / 6);
    const x = Math.round(middle.x / cell) * cell, y = Math.round(middle.y / cell) * cell;
    const z = ground === null ? box.min.z - 0.01 * size : ground - 1e-3 * size;
    floor.position.set(x, y, z);
    grid.scale.set(CELLS * cell, 1, CELLS * cell);
    shadow.scale.setScalar(CELLS / 2 * cell);
    shadow.position.z = -1e-3 * size;
    Object.assign(viewer.camera, { near: size / 100, far: 60 * size });
    Object.assign(viewer.controls, { minDistance: size / 20, maxDistance: 25 * size });
  }

  // --- camera --------------------------------------------------------------------------------

  // The usual direction to see the robot from: a planar robot from its face, a flat one nearly
  // across, others obliquely.
  function usual() {
    if (face) return face;
    const extent = (i) => Math.max(...reach.map((p) => p[i])) - Math.min(...reach.map((p) => p[i]));
    const [x, y, z] = [0, 1, 2].map(extent), flat = 0.25 * Math.max(x, y, z);
    if (z < flat) return [0.25, -0.6, 1.2];
    if (y < flat) return [0.3, -1, 0.25];
    if (x < flat) return [1, 0.3, 0.25];
    return VIEWS.iso;
  }

  // Place the camera in the direction of the view, as near as all points of the reach stay inside
  // the picture. Along an axis of the picture with the slope of its border, a point p stays inside
  // if |p - middle| <= slope * distance along the view: each border gives the nearest place.
  function frame() {
    if (!reach.length || !pane.clientHeight) return;
    const away = up(view === "usual" ? usual() : VIEWS[view]).normalize();
    const ahead = away.clone().negate();
    const right = ahead.clone().cross(new THREE.Vector3(0, 1, 0)).normalize();
    const top = right.clone().cross(ahead);
    const tangent = FILLED * Math.tan(viewer.camera.fov * Math.PI / 360);
    const points = reach.map(up), depths = points.map((p) => p.dot(ahead));
    const fitted = (axis, slope) => {
      const furthest = (sign) =>
        Math.max(...points.map((p, i) => sign * p.dot(axis) - slope * depths[i]));
      const low = furthest(-1), high = furthest(1);
      return { middle: (high - low) / 2, depth: -(low + high) / (2 * slope) };
    };
    const across = fitted(right, tangent * pane.clientWidth / pane.clientHeight);
    const upright = fitted(top, tangent);
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

  // Whether all of the reach is in the picture.
  function inside() {
    viewer.camera.updateMatrixWorld();
    return reach.every((p) => {
      const { x, y, z } = up(p).project(viewer.camera);
      return Math.max(Math.abs(x), Math.abs(y), Math.abs(z)) <= 1;
    });
  }

  viewer.controls.addEventListener("start", () => { view = null; }); // the reader turns it

  function resize() {
    viewer.set_3d_pane_size();
    if (view) frame();
    placeLabels();
  }

  // --- layers and labels ---------------------------------------------------------------------

  // The object at a path. The children of the robot are movers, their children the layers.
  const node = (...path) => viewer.scene_tree.find(["meshcat", "robot", ...path]).object;

  function showLayer(name, on) {
    if (name === "floor") floor.visible = on;
    for (const mover of node().children) {
      const layer = mover.children.find((child) => child.name === name);
      if (layer) layer.visible = on;
    }
    for (const { element, layer } of labels) if (layer === name) element.dataset.on = on;
    viewer.set_dirty();
    placeLabels();
  }

  // Draw arrows once more, faintly, where bodies hide them.
  function showThrough() {
    const layers = node().children.flatMap((mover) => mover.children)
      .filter(({ name }) => ["torques", "reactions"].includes(name));
    const arrows = [];
    for (const layer of layers) {
      layer.traverse((object) => {
        const isNew = object.isMesh && !object.children.length; // others have their copy
        if (isNew && object.material.depthTest) arrows.push(object);
      });
    }
    for (const arrow of arrows) {
      const seen = new THREE.Mesh(arrow.geometry, arrow.material.clone());
      Object.assign(seen.material, { depthTest: false, transparent: true, opacity: 0.4 });
      seen.renderOrder = 1;
      arrow.add(seen);
    }
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

  // --- the hand ------------------------------------------------------------------------------

  const caster = new THREE.Raycaster(), TOUCHED = ["bodies", "skeleton", "inertia"]; // layers

  // Let the caster's ray pass through a place of the window.
  function aim(clientX, clientY) {
    const { left, top, width, height } = pane.getBoundingClientRect();
    const x = (clientX - left) / width * 2 - 1, y = 1 - (clientY - top) / height * 2;
    viewer.camera.updateMatrixWorld();
    caster.setFromCamera(new THREE.Vector2(x, y), viewer.camera);
  }

  const inBase = (vector) => viewer.scene.worldToLocal(vector.clone()).toArray();

  // What is seen at a place of the window: the name of its mover, the point, and the unit vector
  // `ray` of the view, in base axes. It is null if there is nothing.
  function hit(clientX, clientY) {
    aim(clientX, clientY);
    const layers = node().children.flatMap((mover) => mover.children)
      .filter(({ name, visible }) => visible && TOUCHED.includes(name));
    const [first] = caster.intersectObjects(layers, true);
    if (!first) return null;
    let object = first.object;
    while (object.parent !== node()) object = object.parent;
    const { origin, direction } = caster.ray;
    const start = inBase(origin), end = inBase(origin.clone().add(direction));
    return { mover: object.name, point: inBase(first.point), ray: end.map((x, i) => x - start[i]) };
  }

  // The point under a place of the window, in the plane through `point` parallel to the picture;
  // base axes.
  function inPlane(clientX, clientY, point) {
    aim(clientX, clientY);
    const through = viewer.scene.localToWorld(new THREE.Vector3(...point));
    const normal = viewer.camera.getWorldDirection(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, through);
    const found = caster.ray.intersectPlane(plane, new THREE.Vector3());
    return found ? inBase(found) : point;
  }

  // --- loading -------------------------------------------------------------------------------

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
    const ghost = node().children.find(({ name }) => name === "ghost");
    ghost?.traverse((object) => { object.castShadow = false; });
    for (const [name, on] of Object.entries(data.layers)) showLayer(name, on);
    viewer.camera.updateProjectionMatrix();
    // The reader's view stays, if the robot is inside.
    if (isFirst || !inside()) view ??= "usual";
    isFirst = false;
    resize();
  }

  return {
    load, look, resize, placeLabels, showLayer, inside, hit, inPlane,
    place(path, matrix) {
      const object = node(...path);
      matrix.decompose(object.position, object.quaternion, object.scale);
      viewer.set_dirty();
    },
    // Execute a command of Meshcat; an animation does not play, but is sought.
    command(bytes) {
      viewer.handle_command_bytearray(bytes);
      if (viewer.animator.playing) viewer.animator.pause();
    },
    // Show the motion at a time; `indices` is how many of the trail's vertices have been passed.
    seek(time, indices) {
      viewer.animator.seek(time);
      node("0", "trail").traverse((object) => {
        const isPassed = object.isMesh && object.parent.name === "passed";
        if (isPassed) object.geometry.setDrawRange(0, indices);
      });
      viewer.set_dirty();
    },
  };
})();
