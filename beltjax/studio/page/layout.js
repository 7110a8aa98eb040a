// The picture of the drive, in millimeters with y upwards, and the handles on it.

import { page, part, points, drawn, digits } from "./state.js";

const svg = document.getElementById("layout");
const mm = ([x, y]) => [1e3 * x, -1e3 * y];
let box = null; // x, y, width, height of what is seen [mm]
const layers = {};
for (const name of ["ghosts", "pulleys", "wraps", "belts", "contact", "bodies", "loads", "names", "arrows", "handles"]) {
  layers[name] = svg.appendChild(drawn("g", { class: name }));
}

export function pixel() {
  const size = svg.getBoundingClientRect();
  return box ? Math.max(box[2] / size.width, box[3] / size.height) : 1;
}

// The point of the drive [m] under a pointer.
export function under(event) {
  const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  return [at.x / 1e3, -at.y / 1e3];
}

export function fit() {
  const view = page.view;
  if (!view) return;
  const radii = part(view, "radii");
  const around = points(view, "centers").map((at, k) => [mm(at), 1e3 * radii[k]]);
  around.push(...points(view, "pivots").map((at) => [mm(at), 10]));
  const low = [0, 1].map((i) => Math.min(...around.map(([at, r]) => at[i] - r)));
  const high = [0, 1].map((i) => Math.max(...around.map(([at, r]) => at[i] + r)));
  const margin = 0.13 * Math.max(high[0] - low[0], high[1] - low[1]);
  box = [low[0] - margin, low[1] - margin, high[0] - low[0] + 2 * margin, high[1] - low[1] + 2 * margin];
  svg.setAttribute("viewBox", box.join(" "));
}

// The path of each belt: its spans, and arcs on the pulleys.
function beltPaths(view) {
  const starts = points(view, "starts"), ends = points(view, "ends"), centers = points(view, "centers");
  const wraps = part(view, "wraps");
  return page.drive.belts.map(({ start, size }) => {
    let path = "";
    for (let k = 0; k < size; k += 1) {
      const i = start + k, j = start + ((k + 1) % size);
      const radius = 1e3 * Math.hypot(ends[i][0] - centers[j][0], ends[i][1] - centers[j][1]);
      const sweep = page.drive.pulleys[j].turn > 0 ? 0 : 1;
      path += `${k ? "L" : "M"}${mm(starts[i])}L${mm(ends[i])}`;
      path += `A${radius} ${radius} 0 ${wraps[j] > Math.PI ? 1 : 0} ${sweep} ${mm(starts[j])}`;
    }
    return path + "Z";
  });
}

function arrow(from, to, kind, px, attributes = {}) {
  const along = [to[0] - from[0], to[1] - from[1]], size = Math.hypot(...along);
  if (size < 2 * px) return null;
  const [x, y] = along.map((part) => part / size), head = Math.min(9 * px, size * 0.6);
  const neck = [to[0] - head * x, to[1] - head * y];
  const tip = [[to[0], to[1]], [neck[0] - 0.45 * head * y, neck[1] + 0.45 * head * x], [neck[0] + 0.45 * head * y, neck[1] - 0.45 * head * x]];
  return drawn("g", { class: kind, ...attributes },
    drawn("line", { x1: from[0], y1: from[1], x2: neck[0], y2: neck[1] }), drawn("polygon", { points: tip.join(" ") }));
}

export function draw() {
  const view = page.view;
  if (!view || !page.drive) return;
  if (!box) fit();
  const px = pixel(), shown = (name) => document.getElementById(`show-${name}`).checked;
  const centers = points(view, "centers").map(mm), radii = part(view, "radii").map((r) => 1e3 * r);
  const impossible = view.fault;
  document.getElementById("legend").textContent = "";
  drawGhosts(impossible, shown("start"));
  layers.pulleys.replaceChildren(...centers.map((at, k) => drawn("circle", {
    class: `pulley${page.drive.pulleys[k].driver ? " driver" : ""}${impossible && impossible.pulley === k ? " blamed" : ""}`,
    cx: at[0], cy: at[1], r: Math.max(radii[k], 0), "data-pulley": page.drive.pulleys[k].name,
  })));
  layers.belts.replaceChildren();
  layers.wraps.replaceChildren();
  layers.loads.replaceChildren();
  layers.arrows.replaceChildren();
  layers.contact.replaceChildren();
  if (!impossible) {
    layers.belts.append(...beltPaths(view).map((d) => drawn("path", { class: "belt", d })), ...travels(view, px));
    if (shown("wraps")) layers.wraps.append(...wrapArcs(view));
    if (shown("loads")) layers.loads.append(...hubLoads(view, centers, px));
    if (shown("contact") && page.contact) layers.contact.append(...contactArcs());
  }
  drawBodies(view, centers, px);
  drawNames(view, centers, px, shown("wraps") && !impossible);
  const places = drawHandles(view, centers, radii, px);
  if (shown("arrows") && !impossible && page.answer) drawArrows(places, px);
}

function drawGhosts(impossible, start) {
  layers.ghosts.replaceChildren();
  const ghost = (answer, kind) => {
    const view = { flat: answer.values };
    const radii = part(view, "radii");
    layers.ghosts.append(...beltPaths(view).map((d) => drawn("path", { class: kind, d })));
    layers.ghosts.append(...points(view, "centers").map((at, k) => drawn("circle", { class: "ghost", cx: mm(at)[0], cy: mm(at)[1], r: 1e3 * radii[k] })));
  };
  if (page.before) ghost(page.before, "ghost");
  else if (start && page.start) ghost(page.start, "ghost");
  if (impossible && page.good) ghost(page.good, "lastgood");
}

function travels(view, px) {
  const starts = points(view, "starts").map(mm), ends = points(view, "ends").map(mm);
  return starts.map((start, i) => {
    const sign = page.drive.travel > 0 ? 1 : -1, along = [ends[i][0] - start[0], ends[i][1] - start[1]];
    const size = Math.hypot(...along), [x, y] = along.map((one) => (sign * one) / size);
    const at = [start[0] + along[0] / 2, start[1] + along[1] / 2], a = 6 * px;
    const tip = [[at[0] + a * x, at[1] + a * y], [at[0] - a * x - 0.7 * a * y, at[1] - a * y + 0.7 * a * x], [at[0] - a * x + 0.7 * a * y, at[1] - a * y - 0.7 * a * x]];
    return drawn("polygon", { class: "travel", points: tip.join(" "), fill: "#0072b2" });
  });
}

function wrapArcs(view) {
  const starts = points(view, "starts"), ends = points(view, "ends"), centers = points(view, "centers");
  const wraps = part(view, "wraps"), found = [];
  page.drive.belts.forEach(({ start, size }) => {
    for (let k = 0; k < size; k += 1) {
      const i = start + k, j = start + ((k + 1) % size);
      const radius = 1e3 * Math.hypot(ends[i][0] - centers[j][0], ends[i][1] - centers[j][1]);
      const sweep = page.drive.pulleys[j].turn > 0 ? 0 : 1;
      found.push(drawn("path", { class: "wrap", d: `M${mm(ends[i])}A${radius} ${radius} 0 ${wraps[j] > Math.PI ? 1 : 0} ${sweep} ${mm(starts[j])}` }));
    }
  });
  return found;
}

function hubLoads(view, centers, px) {
  const loads = points(view, "hub_loads"), most = Math.max(...loads.map((one) => Math.hypot(...one)), 1e-9);
  const scale = (90 * px) / most;
  return loads.map((load, k) => arrow(centers[k], [centers[k][0] + scale * load[0], centers[k][1] - scale * load[1]], "load", px,
    { "data-load": page.drive.pulleys[k].name })).filter(Boolean);
}

function contactArcs() {
  return page.contact.map(({ zone, points: path }) => drawn("path", {
    class: zone, d: path.map((at, k) => `${k ? "L" : "M"}${mm(at)}`).join(""),
  }));
}

function drawBodies(view, centers, px) {
  const pivots = points(view, "pivots").map(mm);
  layers.bodies.replaceChildren();
  page.answer.bodies.forEach((body, a) => {
    for (const k of body.carries) {
      const [cx, cy] = centers[k], [x, y] = pivots[a];
      if (body.rotary) {
        const arm = [cx - x, cy - y], reach = 1.12;
        const at = (turn) => [x + reach * (Math.cos(turn) * arm[0] + Math.sin(turn) * arm[1]), y + reach * (-Math.sin(turn) * arm[0] + Math.cos(turn) * arm[1])];
        for (const way of [body.to_least, body.to_greatest]) {
          if (way === null) continue;
          const [sx, sy] = at(way);
          layers.bodies.append(drawn("line", { class: "stop", x1: x, y1: y, x2: sx, y2: sy }));
        }
        if (body.to_least !== null && body.to_greatest !== null) {
          const far = reach * Math.hypot(...arm), span = body.to_greatest - body.to_least;
          layers.bodies.append(drawn("path", { class: "stop", d: `M${at(body.to_least)}A${far} ${far} 0 ${span > Math.PI ? 1 : 0} 0 ${at(body.to_greatest)}` }));
        }
        layers.bodies.append(drawn("line", { class: "arm", x1: x, y1: y, x2: cx, y2: cy }));
      } else {
        const [dx, dy] = [body.direction[0], -body.direction[1]], far = 60 * px;
        layers.bodies.append(drawn("line", { class: "arm", x1: cx - far * dx, y1: cy - far * dy, x2: cx + far * dx, y2: cy + far * dy }));
        for (const way of [body.to_least, body.to_greatest]) {
          if (way === null) continue;
          const [sx, sy] = [cx + 1e3 * way * dx, cy + 1e3 * way * dy], wide = 12 * px;
          layers.bodies.append(drawn("line", { class: "stop", x1: sx - wide * dy, y1: sy + wide * dx, x2: sx + wide * dy, y2: sy - wide * dx }));
        }
      }
    }
  });
}

function drawNames(view, centers, px, wrapped) {
  const wraps = part(view, "wraps");
  layers.names.replaceChildren(...centers.map((at, k) => {
    const text = drawn("text", { x: at[0], y: at[1] + 24 * px, "font-size": 12 * px, "text-anchor": "middle", "pointer-events": "none" }, page.drive.pulleys[k].name);
    if (wrapped) text.append(drawn("tspan", { x: at[0], dy: 13 * px }, `${digits((wraps[k] * 180) / Math.PI, 4)}°`));
    return text;
  }));
}

// Where each handle stands [mm].
export function places(view, centers, radii) {
  const pivots = points(view, "pivots").map(mm), found = {};
  for (const one of page.drive.handles) {
    const k = one.place;
    if (one.kind === "center") found[one.key] = centers[k];
    if (one.kind === "rim") found[one.key] = [centers[k][0] + radii[k] * Math.SQRT1_2, centers[k][1] - radii[k] * Math.SQRT1_2];
    if (one.kind === "pivot") found[one.key] = pivots[k];
    if (one.kind === "arm") {
      const tip = middle(centers, k);
      found[one.key] = [(pivots[k][0] + tip[0]) / 2, (pivots[k][1] + tip[1]) / 2];
    }
  }
  return found;
}

export function middle(centers, body) {
  const carried = page.answer.bodies[body].carries.map((k) => centers[k]);
  return [0, 1].map((i) => carried.reduce((sum, at) => sum + at[i], 0) / carried.length);
}

function drawHandles(view, centers, radii, px) {
  const at = places(view, centers, radii);
  if (layers.handles.childElementCount !== page.drive.handles.length) {
    layers.handles.replaceChildren(...page.drive.handles.map((one) => drawn("g", {
      class: "handle", tabindex: 0, role: "button", "aria-roledescription": "draggable handle", "data-handle": one.key,
    }, drawn("circle", { class: "zone" }), grip(one.kind))));
  }
  for (const one of layers.handles.children) {
    const key = one.dataset.handle, handle = page.drive.handles.find((other) => other.key === key);
    one.setAttribute("transform", `translate(${at[key]}) scale(${px})`);
    one.firstChild.setAttribute("r", 14);
    one.setAttribute("aria-label", spoken(handle, view));
    one.classList.toggle("selected", page.selected === key);
    one.classList.toggle("held", page.held !== null && page.held.key === key);
  }
  return at;
}

function grip(kind) {
  if (kind === "center") return drawn("circle", { class: "grip", r: 6 });
  if (kind === "rim") return drawn("circle", { class: "grip", r: 4 });
  if (kind === "pivot") return drawn("rect", { class: "grip", x: -5, y: -5, width: 10, height: 10 });
  return drawn("polygon", { class: "grip", points: "0,-7 7,0 0,7 -7,0" });
}

function spoken(handle, view) {
  const values = handle.names.map((names) => view.numbers[names[0]]);
  const words = handle.kind === "arm" ? `turned by ${digits((values[0] * 180) / Math.PI)} degrees`
    : values.map((value) => `${digits(1e3 * value, 5)} mm`).join(", ");
  return `${handle.label}, ${words}`;
}

// Arrows downhill: the longest of those that move, and of radii, have one length each.
function drawArrows(places, px) {
  const arrows = page.answer.arrows, of = (key) => (key.startsWith("rim") ? "rim" : "move");
  const most = { rim: 0, move: 0 };
  for (const [key, one] of Object.entries(arrows)) most[of(key)] = Math.max(most[of(key)], one.gain);
  for (const [key, one] of Object.entries(arrows)) {
    const from = places[key];
    if (!from) continue;
    let way = [one.x, -one.y];
    const [kind, place] = [key.split(":")[0], Number(key.split(":")[1])];
    if (kind === "rim") way = [one.x * Math.SQRT1_2, -one.x * Math.SQRT1_2];
    if (kind === "arm") {
      // The pivot turns about the middle of the pulleys.
      const centers = points(page.view, "centers").map(mm), tip = middle(centers, place);
      const out = [from[0] - tip[0], from[1] - tip[1]], size = Math.hypot(...out);
      way = [(one.x * out[1]) / size, (-one.x * out[0]) / size];
    }
    const length = (64 * px * one.gain) / most[of(key)];
    const made = arrow(from, [from[0] + length * way[0], from[1] + length * way[1]], "down", px, { "data-arrow": key, "data-gain": one.gain });
    if (made) layers.arrows.append(made);
  }
  const told = Object.values(most).some((gain) => gain > 0);
  document.getElementById("legend").textContent = told
    ? `Green arrows: downhill. The longest gains ${digits(most.move / 1e3, 3)} per mm moved, ${digits(most.rim / 1e3, 3)} per mm of radius.` : "";
}
