// Where everything of an episode is at a time: between two frames, in between. Only numbers: what draws
// is replay_view.js.

// The frames around a time: `a`, `b`, and the part of the way from one to the other.
export function framesAt(trajectory, time) {
  const last = trajectory.frames - 1;
  const at = Math.min(Math.max(time, 0), trajectory.duration) / trajectory.period;
  const a = Math.min(Math.floor(at + 1e-9), last);
  if (a === last) return {a, b: a, part: 0};
  // The last frame may be less than a period after the one before it.
  const span = Math.min((a + 1) * trajectory.period, trajectory.duration) - a * trajectory.period;
  const part = span > 0 ? (at - a) * trajectory.period / span : 1;
  return {a, b: a + 1, part: Math.min(Math.max(part, 0), 1)};
}

// The frame whose values hold at a time: those of things that begin or end.
export function frameAt(trajectory, time) {
  const {a, b, part} = framesAt(trajectory, time);
  return part > 1 - 1e-6 ? b : a;
}

// Fills `position` (3 per body) and `rotation` (w, x, y, z per body).
export function posesAt(trajectory, time, position, rotation) {
  const {a, b, part} = framesAt(trajectory, time);
  const bodies = trajectory.bodies.length;
  const from = trajectory.position;
  for (let i = 0, one = a * 3 * bodies, two = b * 3 * bodies; i < 3 * bodies; i += 1) {
    position[i] = from[one + i] + part * (from[two + i] - from[one + i]);
  }
  const turns = trajectory.rotation;
  for (let i = 0, one = a * 4 * bodies, two = b * 4 * bodies; i < 4 * bodies; i += 4) {
    // Of the two quaternions of each rotation, those that are near each other.
    let near = 0;
    for (let k = i; k < i + 4; k += 1) near += turns[one + k] * turns[two + k];
    const sign = near < 0 ? -1 : 1;
    let size = 0;
    for (let k = i; k < i + 4; k += 1) {
      rotation[k] = (1 - part) * turns[one + k] + part * sign * turns[two + k];
      size += rotation[k] ** 2;
    }
    size = Math.sqrt(size);
    if (size > 1e-6) for (let k = i; k < i + 4; k += 1) rotation[k] /= size;
    else for (let k = i; k < i + 4; k += 1) rotation[k] = turns[one + k];
  }
}

// A point fixed to a body, in the world. `pose` has positions and rotations of bodies.
export function pointOn(pose, body, x, y, z, out, at) {
  if (body < 0) {
    out[at] = x;
    out[at + 1] = y;
    out[at + 2] = z;
    return;
  }
  const w = pose.rotation[4 * body];
  const i = pose.rotation[4 * body + 1];
  const j = pose.rotation[4 * body + 2];
  const k = pose.rotation[4 * body + 3];
  const a = 2 * (j * z - k * y);
  const b = 2 * (k * x - i * z);
  const c = 2 * (i * y - j * x);
  out[at] = pose.position[3 * body] + x + w * a + j * c - k * b;
  out[at + 1] = pose.position[3 * body + 1] + y + w * b + k * a - i * c;
  out[at + 2] = pose.position[3 * body + 2] + z + w * c + i * b - j * a;
}

// The paths of a model's muscles, with their bodies as indices into a pose (below 0: the world), and of
// which muscle of the trajectory each is. `fixed(body, at)` gives a point of a body that never moves in
// the world, as a list.
export function boundPaths(muscles, trajectory, fixed) {
  const indices = new Map(trajectory.bodies.map((body, place) => [body.name, place])
    .filter(([, place]) => !trajectory.bodies[place].target));
  const bound = (point) => {
    if (point.body === null) return {body: -1, wrap: point.wrap, at: point.at};
    if (indices.has(point.body)) {
      return {body: indices.get(point.body), wrap: point.wrap, at: point.at};
    }
    // Wraps are only on what moves.
    return {body: -1, wrap: null, at: fixed(point.body, point.at ?? [0, 0, 0])};
  };
  return muscles.map((muscle) => ({radius: muscle.radius,
    activation: trajectory.muscles.indexOf(muscle.name),
    path: muscle.path.filter((point) => point.wrap === null || (point.wrap < trajectory.wraps
      && (point.body === null || indices.has(point.body)))).map(bound)}));
}

// How many segments the paths have at most.
export function mostSegments(paths) {
  return paths.reduce((sum, {path}) => sum + Math.max(path.reduce((points, point) =>
    points + (point.wrap === null ? 1 : 2), 0) - 1, 0), 0);
}

// The muscles as they run at a time. Fills `ends` (6 numbers per segment: from, to) and `segments` (per
// segment: activation, radius); returns how many there are.
export function segmentsAt(trajectory, paths, pose, time, ends, segments) {
  const {a, b, part} = framesAt(trajectory, time);
  const {wrap, wraps, activation, muscles} = trajectory;
  let count = 0;
  for (const muscle of paths) {
    const one = a * muscles.length + muscle.activation;
    const two = b * muscles.length + muscle.activation;
    const active = muscle.activation < 0 ? 0
      : activation[one] + part * (activation[two] - activation[one]);
    let begun = false;
    const add = (body, x, y, z) => {
      const at = 6 * count;
      if (begun) {
        pointOn(pose, body, x, y, z, ends, at + 3);
        segments[2 * count] = active;
        segments[2 * count + 1] = muscle.radius;
        count += 1;
        if (6 * count < ends.length) ends.copyWithin(6 * count, at + 3, at + 6);
      } else {
        pointOn(pose, body, x, y, z, ends, at);
        begun = true;
      }
    };
    for (const point of muscle.path) {
      if (point.wrap === null) {
        add(point.body, ...point.at);
        continue;
      }
      const first = 7 * (a * wraps + point.wrap);
      const then = 7 * (b * wraps + point.wrap);
      if (!wrap[first]) continue;
      // Towards a frame in which it does not wrap, its points stay.
      const way = wrap[then] ? part : 0;
      for (const at of [1, 4]) {
        add(point.body, wrap[first + at] + way * (wrap[then + at] - wrap[first + at]),
          wrap[first + at + 1] + way * (wrap[then + at + 1] - wrap[first + at + 1]),
          wrap[first + at + 2] + way * (wrap[then + at + 2] - wrap[first + at + 2]));
      }
    }
  }
  return count;
}

// Where the camera looks over time: at a body, without the ups and downs of its steps. 3 numbers per
// frame.
export function followedPath(trajectory, name, offset) {
  const body = trajectory.bodies.findIndex((one) => one.name === name);
  if (body < 0) return null;
  const {frames, position, bodies} = trajectory;
  const reach = Math.max(Math.round(0.4 / trajectory.period), 1);
  const path = new Float32Array(3 * frames);
  for (let axis = 0; axis < 3; axis += 1) {
    const sums = new Float64Array(frames + 1);
    for (let i = 0; i < frames; i += 1) {
      sums[i + 1] = sums[i] + position[(i * bodies.length + body) * 3 + axis];
    }
    for (let i = 0; i < frames; i += 1) {
      // As many frames before as after it, so that it neither leads nor lags at the ends.
      const side = Math.min(reach, i, frames - 1 - i);
      path[3 * i + axis] = (sums[i + side + 1] - sums[i - side]) / (2 * side + 1) + offset[axis];
    }
  }
  return path;
}

// The point of such a path at a time.
export function pointAt(trajectory, path, time, out) {
  const {a, b, part} = framesAt(trajectory, time);
  for (let axis = 0; axis < 3; axis += 1) {
    out[axis] = path[3 * a + axis] + part * (path[3 * b + axis] - path[3 * a + axis]);
  }
}
