// What was measured besides the facts: joints, obstacles, and when things happened.
import {ranges, shares, strips} from "./charts.js";
import {h} from "./dom.js";
import {number, whole} from "./format.js";

// Numbers of an episode that are times, by their keys.
export const TIMES = {first_contact_time: "first contact", handover_time: "handover",
  release_time: "release", goal_contact_time: "goal reached", peak_force_time: "peak force",
  settle_time: "settled", solved_time: "solved", fall_time: "fall"};

const degrees = (radians) => radians * 180 / Math.PI;
const words = (key) => key.replaceAll("_", " ");

// When what happened, of rows whose details have some of the TIMES.
export function times(rows, outcomeOf) {
  const points = rows.flatMap((row) => Object.entries(TIMES).map(([key, kind]) => ({kind,
    value: row.details?.[key], outcome: outcomeOf(row), index: row.index})))
    .filter((point) => typeof point.value === "number");
  return strips("When it happened (s of simulated time)", points, {unit: "s"},
    Object.values(TIMES));
}

function obstacles(values) {
  const kinds = Object.entries(values.obstacle_heights ?? {});
  if (!kinds.length) return null;
  const most = Math.max(...kinds.map(([, of]) => of.max ?? 0));
  return shares("Highest obstacle passed", kinds.map(([kind, of]) => ({kind, part: of.max ?? 0,
    of: most, text: of.count ? `${number(of.max, 2)} m` : "none"})),
  kinds.map(([kind, of]) => `${kind}: passed in ${whole(of.count)} episodes`).join("; "));
}

// The sums of pain are of (limit torque in N m)/1000.
function pain(values, summary) {
  const joints = Object.entries(values.pain_by_joint ?? {});
  if (!joints.length || !summary.steps) return null;
  const torque = ([joint, of]) => [joint, 1000 * of.mean * of.count / summary.steps];
  const rows = joints.map(torque).sort((a, b) => b[1] - a[1]);
  return shares("Pain by joint", rows.map(([joint, mean]) => ({kind: words(joint), part: mean,
    of: rows[0][1], text: `${number(mean, 2)} N m`})),
  "The mean limit torque over all steps: what overstretches the joint.");
}

function joints(values) {
  const rows = Object.entries(values.joint_ranges ?? {})
    .filter(([, of]) => of[0]?.count)
    .map(([joint, [low, high, limitLow, limitHigh]]) => ({name: words(joint),
      low: degrees(low.min), high: degrees(high.max), limit_low: degrees(limitLow.min),
      limit_high: degrees(limitHigh.max)}));
  return rows.length ? ranges("Joint angles and their limits (°)", rows, "°") : null;
}

// Charts of `details_summary` of the API.
export function summaryCharts(summary, total) {
  if (!summary) return [];
  const {values} = summary;
  const some = summary.episodes < total && h("p", {class: "quiet"},
    `Of the ${whole(summary.episodes)} episodes of which details are known.`);
  return [obstacles(values), pain(values, summary), joints(values)].filter((chart) => chart)
    .map((chart) => {
      if (some) chart.append(some.cloneNode(true));
      return chart;
    });
}
