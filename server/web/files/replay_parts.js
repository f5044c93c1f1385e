// What a replay draws besides the bodies: muscles, forces, the ground.
import * as three from "./three.js";
import {visible} from "./format.js";

const IDLE = new three.Color(0x7f93ad);
const ACTIVE = new three.Color(0xe8321e);

// Writes the matrix that lays a cylinder of height 1 and radius 1 from one point to another.
function layBetween(array, index, ends, at, radius) {
  const x = ends[at + 3] - ends[at];
  const y = ends[at + 4] - ends[at + 1];
  const z = ends[at + 5] - ends[at + 2];
  const length = Math.max(Math.hypot(x, y, z), 1e-9);
  // Two directions across the way: of the first, the axis that is the least along it is left out.
  const flat = Math.abs(z) < 0.9 * length;
  let ax = flat ? y : 0;
  let ay = flat ? -x : z;
  let az = flat ? 0 : -y;
  const size = radius / Math.max(Math.hypot(ax, ay, az), 1e-12);
  ax *= size;
  ay *= size;
  az *= size;
  array.set([ax, ay, az, 0, x, y, z, 0,
    (ay * z - az * y) / length, (az * x - ax * z) / length, (ax * y - ay * x) / length, 0,
    ends[at] + x / 2, ends[at + 1] + y / 2, ends[at + 2] + z / 2, 1], 16 * index);
}

function many(geometry, material, count) {
  const mesh = new three.InstancedMesh(geometry, material, Math.max(count, 1));
  mesh.count = 0;
  mesh.frustumCulled = false;
  mesh.instanceMatrix.setUsage(three.DynamicDrawUsage);
  return mesh;
}

// Muscles as tubes, coloured and thickened by their activation.
export class Tubes {
  constructor(most) {
    const material = new three.MeshStandardMaterial({roughness: 0.55});
    this.mesh = many(new three.CylinderGeometry(1, 1, 1, 7, 1, true), material, most);
    this.mesh.castShadow = true;
    const colors = new Float32Array(3 * Math.max(most, 1));
    this.mesh.instanceColor = new three.InstancedBufferAttribute(colors, 3);
    this.mesh.instanceColor.setUsage(three.DynamicDrawUsage);
    this.ends = new Float32Array(6 * Math.max(most, 1));
    this.segments = new Float32Array(2 * Math.max(most, 1));
  }

  // Shows the first `count` of `ends` and `segments` (as segmentsAt fills them).
  show(count) {
    const matrices = this.mesh.instanceMatrix.array;
    const colors = this.mesh.instanceColor.array;
    for (let i = 0; i < count; i += 1) {
      const active = this.segments[2 * i];
      layBetween(matrices, i, this.ends, 6 * i, this.segments[2 * i + 1] * (1 + 0.6 * active));
      colors[3 * i] = IDLE.r + active * (ACTIVE.r - IDLE.r);
      colors[3 * i + 1] = IDLE.g + active * (ACTIVE.g - IDLE.g);
      colors[3 * i + 2] = IDLE.b + active * (ACTIVE.b - IDLE.b);
    }
    this.mesh.count = count;
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.instanceColor.needsUpdate = true;
  }
}

// Contact forces as arrows: `longest` m for `strong` N and more.
export class Arrows {
  constructor(most, longest, strong) {
    const material = new three.MeshStandardMaterial({color: 0xf2a100, emissive: 0x6b4600,
      roughness: 0.4});
    this.shafts = many(new three.CylinderGeometry(1, 1, 1, 10), material, most);
    this.heads = many(new three.ConeGeometry(1, 1, 14), material, most);
    this.group = new three.Group();
    this.group.add(this.shafts, this.heads);
    this.thick = longest / 80;
    this.longest = longest;
    this.strong = strong;
    this.ends = new Float32Array(6);
  }

  // Lengths grow with the square root of the force: the largest is many times as strong as most others, which would
  // not be seen beside it.
  lengthOf(force) {
    return this.strong > 0 ? this.longest * Math.min(Math.sqrt(force / this.strong), 1) : 0;
  }

  // Shows the contacts `first` to `last`, without it, of 6 numbers each: point, force.
  show(values, first, last) {
    let count = 0;
    for (let i = first; i < last; i += 1) {
      const [x, y, z, fx, fy, fz] = values.subarray(6 * i, 6 * i + 6);
      const force = Math.hypot(fx, fy, fz);
      const length = this.lengthOf(force);
      if (length < 0.4 * this.thick) continue;
      const whole = length / force;
      const part = Math.max(length - 4 * this.thick, 0.4 * length) / force;
      this.ends.set([x, y, z, x + fx * part, y + fy * part, z + fz * part]);
      layBetween(this.shafts.instanceMatrix.array, count, this.ends, 0, this.thick);
      this.ends.set([x + fx * part, y + fy * part, z + fz * part,
        x + fx * whole, y + fy * whole, z + fz * whole]);
      layBetween(this.heads.instanceMatrix.array, count, this.ends, 0, 2.4 * this.thick);
      count += 1;
    }
    for (const mesh of [this.shafts, this.heads]) {
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
    }
  }
}

// Two shades of squares with sides of 1: what a ground is drawn with.
function squares(light, dark) {
  const one = new three.Color(light);
  const two = new three.Color(dark);
  const pixel = (color) => [color.r, color.g, color.b].map((part) => 255 * part).concat(255);
  const data = new Uint8Array([pixel(one), pixel(two), pixel(two), pixel(one)].flat());
  const texture = new three.DataTexture(data, 2, 2);
  texture.wrapS = three.RepeatWrapping;
  texture.wrapT = three.RepeatWrapping;
  texture.magFilter = three.NearestFilter;
  texture.minFilter = three.LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.anisotropy = 8;
  texture.needsUpdate = true;
  return texture;
}

function groundMaterial(colors) {
  return new three.MeshStandardMaterial({map: squares(...colors), roughness: 0.95});
}

// The terrain that an episode had, with squares of 1 m.
export function terrainMesh(terrain, colors) {
  const {rows, columns, low, high, heights} = terrain;
  const points = new Float32Array(3 * rows * columns);
  const places = new Float32Array(2 * rows * columns);
  for (let row = 0, at = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1, at += 1) {
      const x = low[0] + (high[0] - low[0]) * column / (columns - 1);
      const y = low[1] + (high[1] - low[1]) * row / (rows - 1);
      points.set([x, y, heights[column * rows + row]], 3 * at);
      places.set([x / 2, y / 2], 2 * at);
    }
  }
  const corners = new Uint32Array(6 * (rows - 1) * (columns - 1));
  for (let row = 0, at = 0; row < rows - 1; row += 1) {
    for (let column = 0; column < columns - 1; column += 1, at += 6) {
      const a = row * columns + column;
      corners.set([a, a + 1, a + columns + 1, a, a + columns + 1, a + columns], at);
    }
  }
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(points, 3));
  geometry.setAttribute("uv", new three.BufferAttribute(places, 2));
  geometry.setIndex(new three.BufferAttribute(corners, 1));
  // Each face by its own normal, so that the edges of steps are seen.
  const faces = geometry.toNonIndexed();
  geometry.dispose();
  faces.computeVertexNormals();
  const mesh = new three.Mesh(faces, groundMaterial(colors));
  mesh.receiveShadow = true;
  mesh.castShadow = true;
  return mesh;
}

// A level floor around the origin.
export function floorMesh({height, square, halfSize}, colors) {
  const [x, y] = halfSize;
  const geometry = new three.PlaneGeometry(2 * x, 2 * y);
  const places = geometry.attributes.uv;
  for (let i = 0; i < places.count; i += 1) {
    places.setXY(i, (places.getX(i) - 0.5) * x / square, (places.getY(i) - 0.5) * y / square);
  }
  const mesh = new three.Mesh(geometry, groundMaterial(colors));
  mesh.position.z = height;
  mesh.receiveShadow = true;
  return mesh;
}

// Words that face the reader, so high.
function textSprite(text, color, high, more = {}) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "600 48px system-ui, sans-serif";
  context.font = font;
  canvas.width = Math.min(Math.ceil(context.measureText(text).width) + 32, 2048);
  canvas.height = 64;
  Object.assign(context, {font, fillStyle: color, textAlign: "center", textBaseline: "middle"});
  context.fillText(text, canvas.width / 2, 34, canvas.width);
  const map = new three.CanvasTexture(canvas);
  map.colorSpace = three.SRGBColorSpace;
  const sprite = new three.Sprite(new three.SpriteMaterial({map, transparent: true, ...more}));
  sprite.scale.set(high * canvas.width / canvas.height, high, 1);
  return sprite;
}

// The shapes of a body once more, translucent: where it should come to. Beside it in the scene.
export function targetOf(node) {
  const copy = node.clone();
  const material = new three.MeshStandardMaterial({color: 0x1f9d5c, transparent: true, opacity: 0.4, depthWrite: false,
    roughness: 0.8});
  copy.traverse((part) => {
    if (!part.isMesh) return;
    part.material = material;
    part.castShadow = false;
  });
  node.parent.add(copy);
  return copy;
}

const MOST_NAMES = 5;
const MOST_KEPT = 100;
const NAME_HIGH = 0.024;  // of what is seen 1 m away

// Beside the heads of the longest arrows the bodies that touch there, each pair once.
export class Names {
  constructor(arrows, color) {
    Object.assign(this, {arrows, color, group: new three.Group(), known: new Map()});
    this.group.visible = false;
  }

  // Of the contacts `first` to `last`, without it (readTrajectory).
  show({values, bodiesOf}, first, last) {
    for (const sprite of this.known.values()) sprite.visible = false;
    const forces = Array.from({length: last - first}, (_, i) => ({contact: first + i,
      force: Math.hypot(...values.subarray(6 * (first + i) + 3, 6 * (first + i) + 6))}));
    let shown = 0;
    for (const {contact, force} of forces.sort((a, b) => b.force - a.force)) {
      if (shown === MOST_NAMES || !force) return;
      const [on, by] = bodiesOf(contact);
      const sprite = this.spriteOf(visible(by ? `${by} → ${on}` : on));
      if (sprite.visible) continue;
      const along = this.arrows.lengthOf(force) / force;
      const [x, y, z, fx, fy, fz] = values.subarray(6 * contact, 6 * contact + 6);
      sprite.position.set(x + fx * along, y + fy * along, z + fz * along);
      sprite.visible = true;
      shown += 1;
    }
  }

  spriteOf(text) {
    if (!this.known.has(text)) {
      if (this.known.size === MOST_KEPT) this.forget();
      const sprite = textSprite(text, this.color, NAME_HIGH, {sizeAttenuation: false, depthTest: false});
      sprite.center.set(0, 0.5);
      sprite.visible = false;
      this.known.set(text, sprite);
      this.group.add(sprite);
    }
    return this.known.get(text);
  }

  forget() {
    for (const {material} of this.known.values()) {
      material.map.dispose();
      material.dispose();
    }
    this.known.clear();
    this.group.clear();
  }
}

const MARK_M = 5;       // from one to the next
const MARK_WIDE_M = 0.04;
const MARK_ABOVE_M = 0.012;
const NUMBER_M = 0.24;  // high

function numberAt(text, color, place) {
  const sprite = textSprite(text, color, NUMBER_M);
  sprite.position.set(...place);
  return sprite;
}

// Lines across a terrain every few metres of the course (courseOf of replay_map.js), with their numbers beside it.
export function courseMarks({rows, columns, low, high, heights}, {axis, way, start}, color) {
  const sides = [columns, rows];
  const cell = (of, value) => Math.round((value - low[of]) / (high[of] - low[of]) * (sides[of] - 1));
  const across = 1 - axis;
  const group = new three.Group();
  const points = [];
  for (let far = 0; ; far += MARK_M) {
    const along = start + way * far;
    if (along < low[axis] || along > high[axis]) break;
    const at = (place, shift) => {
      const own = [cell(axis, along), place];
      const [column, row] = axis ? [own[1], own[0]] : own;
      const x = low[across] + (high[across] - low[across]) * place / (sides[across] - 1);
      const z = heights[column * rows + row] + MARK_ABOVE_M;
      return axis ? [x, along + shift, z] : [along + shift, x, z];
    };
    for (let place = 0; place + 1 < sides[across]; place += 1) {
      const [a, b, c, d] = [[place, -1], [place + 1, -1], [place, 1], [place + 1, 1]]
        .map(([one, side]) => at(one, side * MARK_WIDE_M / 2));
      points.push(...a, ...b, ...d, ...a, ...d, ...c);
    }
    const edge = at(sides[across] - 1, 0);
    edge[across] += NUMBER_M;
    edge[2] += 0.6 * NUMBER_M;
    group.add(numberAt(`${far} m`, color, edge));
  }
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(points), 3));
  group.add(new three.Mesh(geometry, new three.MeshBasicMaterial({color, side: three.DoubleSide})));
  return group;
}
