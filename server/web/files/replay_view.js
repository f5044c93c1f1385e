// An episode in 3D: the bodies of the model in their poses, muscles, forces and the ground. Axes are
// MuJoCo's, with z up.
import * as three from "./three.js";
import * as gltf from "./three_gltf_loader.js";
import * as orbit from "./three_orbit_controls.js";
import {FileError, readModelExtras} from "./replay_file.js";
import {courseOf, isCourse} from "./replay_map.js";
import {Arrows, Names, Tubes, courseMarks, floorMesh, targetOf, terrainMesh} from "./replay_parts.js";
import {boundPaths, followedPath, frameAt, mostSegments, pointAt, posesAt, segmentsAt}
  from "./replay_pose.js";

const MOST_CONTACTS = 12;
const SCENERY_M = 2;  // fixed shapes that are larger are the room around, which hides what happens,
const LOW_M = 0.75;    // unless they are low, as a fence
const LIGHT = {ground: 0xe6eaf4, squares: [0xd3d9e8, 0xbfc8dc], sky: 2.1, marks: "#39425c"};
const DARK = {ground: 0x151927, squares: [0x3a4158, 0x30374c], sky: 1.5, marks: "#c3cbe0"};

// Whether this browser draws in 3D.
export function canDraw() {
  try {
    const context = document.createElement("canvas").getContext("webgl2");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return context !== null;
  } catch {
    return false;
  }
}

// A model file as GLTFLoader reads it, with what it tells besides (replay_file.js). Throws FileError.
export async function readModel(buffer) {
  let file;
  try {
    file = await new gltf.GLTFLoader().parseAsync(buffer, "");
  } catch (error) {
    throw new FileError(`The model's file can't be read: ${String(error.message).slice(0, 200)}`);
  }
  return {scene: file.scene, extras: readModelExtras(file.scene.userData)};
}

function nodesByName(scene) {
  const nodes = new Map();
  scene.traverse((node) => {
    const name = node.userData.name ?? node.name;
    if (name && !node.isMesh && !nodes.has(name)) nodes.set(name, node);
  });
  return nodes;
}

function prepare(mesh) {
  mesh.castShadow = !mesh.material.transparent;
  mesh.receiveShadow = true;
  const {color} = mesh.material;
  if (color) color.setRGB(...color.toArray().map((part) => Math.min(Math.max(part, 0), 1)));
}

function lights(style) {
  const sun = new three.DirectionalLight(0xffffff, 2.2);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  sun.shadow.bias = -0.0004;
  sun.shadow.normalBias = 0.01;
  return {sun, sky: new three.HemisphereLight(0xffffff, 0x9a9488, style.sky)};
}

// The direction in which the camera of a model looks (README.md of sim/trajectory, camera).
function lookDirection(camera) {
  const azimuth = camera.azimuth * Math.PI / 180;
  const elevation = camera.elevation * Math.PI / 180;
  return new three.Vector3(Math.cos(elevation) * Math.cos(azimuth),
    Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation));
}

const POINTS = {side: [0, -10], front: [90, -10], back: [-90, -10], top: [0, -85]};
export const VIEWPOINTS = ["start", ...Object.keys(POINTS), "close-up"];
const CLOSE = 0.35;  // of the first view's distance

export class View {
  // Draws into `host`, an element with a size. `model` of readModel, which belongs to the view from
  // then on; `strong`, the force in N of the longest arrows. `onMove` is told when the reader has
  // turned the view. Throws if there is no WebGL, and FileError if the files don't fit each other.
  constructor(host, trajectory, model, {dark, strong, onMove}) {
    if (model.extras.model !== trajectory.model) {
      throw new FileError("This replay was made for another version of the model than the server "
        + "has: reload the page.");
    }
    this.host = host;
    this.trajectory = trajectory;
    this.first = model.extras.camera;
    this.renderer = new three.WebGLRenderer({antialias: true});
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = three.PCFSoftShadowMap;
    this.scene = new three.Scene();
    this.following = true;
    this.most = 2;  // pixels per pixel of the page, at most
    this.addWorld(model, dark ? DARK : LIGHT, strong);
    this.addCamera(onMove);
    host.append(this.renderer.domElement);
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(host);
    this.fit();
  }

  addWorld(model, style, strong) {
    this.scene.background = new three.Color(style.ground);
    this.scene.fog = new three.Fog(style.ground, 5 * this.first.distance, 16 * this.first.distance);
    const {sun, sky} = lights(style);
    this.sun = sun;
    this.scene.add(sky, sun, sun.target);
    const nodes = nodesByName(model.scene);
    const world = nodes.get("world") ?? model.scene;
    world.rotation.set(0, 0, 0);
    this.scene.add(world);
    world.updateMatrixWorld(true);
    world.traverse((part) => part.isMesh && prepare(part));
    nodes.get("static")?.traverse((part) => {
      if (!part.isMesh) return;
      const size = new three.Box3().setFromObject(part, true).getSize(new three.Vector3());
      part.visible = Math.max(size.x, size.y, size.z) <= SCENERY_M || size.z <= LOW_M;
    });
    this.addBodies(nodes);
    this.addMuscles(model.extras.muscles, nodes);
    this.arrows = new Arrows(MOST_CONTACTS, 0.32 * this.first.distance, strong);
    this.names = new Names(this.arrows, style.marks);
    this.scene.add(this.arrows.group, this.names.group);
    const {terrain} = this.trajectory;
    const {floor} = model.extras;
    if (terrain) {
      this.scene.add(terrainMesh(terrain, style.squares));
      if (isCourse(terrain)) this.scene.add(courseMarks(terrain, courseOf(this.trajectory), style.marks));
    } else if (floor) this.scene.add(floorMesh(floor, style.squares));
  }

  addBodies(nodes) {
    const {bodies} = this.trajectory;
    this.pose = {position: new Float32Array(3 * bodies.length),
      rotation: new Float32Array(4 * bodies.length)};
    this.nodes = bodies.map((body) => {
      const node = nodes.get(body.name) ?? null;
      return node && body.target ? targetOf(node) : node;
    });
    bodies.forEach((body, place) => {
      if (body.scale) this.nodes[place]?.scale.set(...body.scale);
    });
  }

  addMuscles(muscles, nodes) {
    this.paths = boundPaths(muscles, this.trajectory, (body, at) =>
      new three.Vector3(...at).applyMatrix4(nodes.get(body)?.matrixWorld ?? new three.Matrix4())
        .toArray());
    this.tubes = new Tubes(mostSegments(this.paths));
    this.scene.add(this.tubes.mesh);
  }

  addCamera(onMove) {
    const {distance, body, lookAt} = this.first;
    this.camera = new three.PerspectiveCamera(38, 1, 0.01 * distance, 20 * distance);
    this.camera.up.set(0, 0, 1);
    this.controls = new orbit.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.minDistance = 0.1 * distance;
    this.controls.maxDistance = 6 * distance;
    this.controls.addEventListener("change", () => {
      if (!this.moving) onMove?.(this);
    });
    this.followed = body === null ? null : followedPath(this.trajectory, body, lookAt);
    this.target = new three.Vector3(...lookAt);
    this.lookFrom("start");
  }

  // From one of VIEWPOINTS, at the distance of the first view; the close-up is of what touches now.
  lookFrom(name) {
    const direction = lookDirection(name in POINTS
      ? {azimuth: POINTS[name][0], elevation: POINTS[name][1]} : this.first);
    this.follow(this.time ?? 0);
    const close = name === "close-up";
    this.controls.target.copy(close && this.touching() || this.target);
    this.camera.position.copy(this.controls.target).addScaledVector(direction, -this.first.distance * (close ? CLOSE : 1));
    this.update();
  }

  // The middle of the contacts, each as much as its force; null without one.
  touching() {
    const {first, values} = this.trajectory.contacts;
    const frame = frameAt(this.trajectory, this.time ?? 0);
    const middle = new three.Vector3();
    let whole = 0;
    for (let i = first[frame]; i < first[frame + 1]; i += 1) {
      const force = Math.hypot(...values.subarray(6 * i + 3, 6 * i + 6));
      middle.addScaledVector(new three.Vector3(...values.subarray(6 * i, 6 * i + 3)), force);
      whole += force;
    }
    return whole > 0 ? middle.divideScalar(whole) : null;
  }

  // Where the camera is around what it looks at: azimuth and elevation in degrees, and the distance in m.
  angles() {
    const from = this.camera.position.clone().sub(this.controls.target);
    const distance = from.length();
    return [Math.atan2(from.y, from.x) * 180 / Math.PI, Math.asin(from.z / distance) * 180 / Math.PI, distance];
  }

  // Puts it there.
  placeCamera([azimuth, elevation, distance]) {
    const [a, e] = [azimuth, Math.min(Math.max(elevation, -89), 89)].map((angle) => angle * Math.PI / 180);
    const far = Math.min(Math.max(distance, this.controls.minDistance), this.controls.maxDistance);
    this.camera.position.copy(this.controls.target).add(new three.Vector3(far * Math.cos(e) * Math.cos(a),
      far * Math.cos(e) * Math.sin(a), far * Math.sin(e)));
    this.update();
  }

  // Moves the camera without telling onMove.
  update() {
    this.moving = true;
    this.controls.update();
    this.moving = false;
  }

  // Looks as another view does, from the same side and distance of what each looks at.
  lookLike(other) {
    this.camera.position.copy(other.camera.position).sub(other.controls.target)
      .add(this.controls.target);
    this.update();
  }

  // Turns by angles in degrees, and comes so many times as near.
  turn(azimuth, elevation, nearer = 1) {
    const from = this.camera.position.clone().sub(this.controls.target);
    const place = new three.Spherical(from.length(), Math.acos(from.z / from.length()),
      Math.atan2(from.y, from.x));
    place.theta += azimuth * Math.PI / 180;
    place.phi = Math.min(Math.max(place.phi - elevation * Math.PI / 180, 0.02), Math.PI - 0.02);
    place.radius = Math.min(Math.max(place.radius / nearer, this.controls.minDistance),
      this.controls.maxDistance);
    this.camera.position.copy(this.controls.target).add(new three.Vector3(
      place.radius * Math.sin(place.phi) * Math.cos(place.theta),
      place.radius * Math.sin(place.phi) * Math.sin(place.theta),
      place.radius * Math.cos(place.phi)));
    this.update();
  }

  // Lets the camera go along with what it looks at.
  follow(time) {
    if (!this.followed || !this.following) return;
    const before = this.target.clone();
    const now = [0, 0, 0];
    pointAt(this.trajectory, this.followed, time, now);
    this.target.set(...now);
    const by = this.target.clone().sub(before);
    this.controls.target.add(by);
    this.camera.position.add(by);
  }

  // Places everything as it is at a time, without drawing it.
  place(time) {
    const {trajectory, pose} = this;
    posesAt(trajectory, time, pose.position, pose.rotation);
    this.nodes.forEach((node, body) => {
      if (!node) return;
      node.position.fromArray(pose.position, 3 * body);
      const [w, x, y, z] = pose.rotation.subarray(4 * body, 4 * body + 4);
      node.quaternion.set(x, y, z, w);
    });
    if (this.tubes.mesh.visible) {
      this.tubes.show(segmentsAt(trajectory, this.paths, pose, time, this.tubes.ends,
        this.tubes.segments));
    }
    if (this.arrows.group.visible) {
      const {contacts} = trajectory;
      const frame = frameAt(trajectory, time);
      const between = [contacts.first[frame], contacts.first[frame + 1]];
      this.arrows.show(contacts.values, ...between);
      if (this.names.group.visible) this.names.show(contacts, ...between);
    }
    this.follow(time);
    this.placeLights();
  }

  placeLights() {
    const reach = 0.75 * this.first.distance;
    const at = this.controls.target;
    this.sun.position.set(at.x + 0.9 * reach, at.y - 0.8 * reach, at.z + 2.2 * reach);
    this.sun.target.position.copy(at);
    const {camera} = this.sun.shadow;
    if (camera.right === reach) return;
    Object.assign(camera, {left: -reach, right: reach, top: reach, bottom: -reach,
      near: 0.05 * reach, far: 6 * reach});
    camera.updateProjectionMatrix();
  }

  draw(time) {
    this.time = time;
    this.place(time);
    this.update();
    this.renderer.render(this.scene, this.camera);
  }

  // What is seen, as a PNG.
  picture() {
    this.draw(this.time ?? 0);  // what a browser showed once may be gone
    return new Promise((resolve) => {
      this.renderer.domElement.toBlob(resolve, "image/png");
    });
  }

  showMuscles(shown) {
    this.tubes.mesh.visible = shown;
  }

  showForces(shown) {
    this.arrows.group.visible = shown;
    this.showNames(this.named);
  }

  // Of the bodies at the arrows, if those are shown.
  showNames(shown) {
    this.named = shown;
    this.names.group.visible = Boolean(shown && this.arrows.group.visible && this.trajectory.contacts.bodiesOf);
  }

  // Less beautiful, for computers that are slow to draw: 1 is without shadows, 2 also coarse.
  simplify(level) {
    this.renderer.shadowMap.enabled = false;
    this.sun.castShadow = false;
    this.most = level > 1 ? 0.5 : 1;
    this.fit();
  }

  // Draws in this size, {width, height} in pixels, until null gives it that of its place again.
  holdSize(size) {
    this.held = size;
    this.fit();
  }

  fit() {
    const {clientWidth, clientHeight} = this.host;
    const {width, height} = this.held ?? {width: clientWidth, height: clientHeight};
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.held ? 1 : Math.min(devicePixelRatio, this.most));
    this.renderer.setSize(width, height, !this.held);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.time !== undefined) this.draw(this.time);
  }

  get stats() {
    const {calls, triangles} = this.renderer.info.render;
    return {calls, triangles, memory: {...this.renderer.info.memory}};
  }

  // Frees all memory; the view can't be used any more.
  dispose() {
    this.observer.disconnect();
    this.controls.dispose();
    this.scene.traverse((part) => {
      part.geometry?.dispose();
      part.material?.map?.dispose();
      part.material?.dispose();
      if (part.isInstancedMesh || part.isLight) part.dispose();
    });
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.renderer.domElement.remove();
  }
}
