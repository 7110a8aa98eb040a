// Dragging by pointer and by keys: from where something is to the numbers of the drive file.

import { page, points, predicted, element, unit } from "./state.js";
import { under, middle } from "./layout.js";

const svg = document.getElementById("layout");
const TURN = Math.PI / 180;
let say, redraw;

export function begin(send, drawAll) {
  [say, redraw] = [send, drawAll];
  svg.addEventListener("pointerdown", press);
  svg.addEventListener("pointermove", drag);
  svg.addEventListener("pointerup", release);
  svg.addEventListener("pointercancel", release);
  svg.addEventListener("keydown", key);
  svg.addEventListener("focusin", (event) => select(handleAt(event)));
}

const handleAt = (event) => {
  const one = event.target.closest("[data-handle]");
  return one ? page.drive.handles.find((other) => other.key === one.dataset.handle) : null;
};

function select(handle) {
  if (!handle || page.selected === handle.key) return;
  page.selected = handle.key;
  showExact();
  redraw();
}

function press(event) {
  const handle = handleAt(event);
  if (!handle || !page.answer || page.held || page.searching || event.button) return;
  const one = event.target.closest("[data-handle]");
  one.setPointerCapture(event.pointerId);
  const centers = points(page.view, "centers"), at = under(event);
  page.held = { key: handle.key, handle, pointer: event.pointerId, from: at, numbers: { ...page.view.numbers }, moved: false };
  if (handle.kind === "rim") page.held.around = centers[handle.place];
  if (handle.kind === "arm") page.held.around = middle(centers, handle.place);
  select(handle);
  say({ do: "begin" });
}

function drag(event) {
  const held = page.held;
  if (!held || event.pointerId !== held.pointer) return;
  const values = changed(held, under(event));
  held.values = values;
  held.moved = true;
  page.view = predicted(page.answer, values);
  redraw();
  say({ do: "move", values, handle: held.key, number: (page.sent = (page.sent || 0) + 1) });
  page.sentAt.set(page.sent, performance.now());
}

function release(event) {
  const held = page.held;
  if (!held || event.pointerId !== held.pointer) return;
  page.held = null;
  say({ do: "end", what: `dragged the ${held.handle.label}`, handle: held.key });
  redraw();
}

// The numbers that a pointer's way makes of those where it began.
function changed(held, at) {
  const { handle, from, around, numbers } = held, values = {};
  const put = (way, value, step) => handle.names[way].forEach((name) => { values[name] = snapped(value, step); });
  const first = (way) => numbers[handle.names[way][0]];
  if (handle.kind === "rim") {
    const far = (point) => Math.hypot(point[0] - around[0], point[1] - around[1]);
    put(0, Math.max(first(0) + far(at) - far(from), 1e-4), 1e-3);
  } else if (handle.kind === "arm") {
    const angle = (point) => Math.atan2(point[1] - around[1], point[0] - around[0]);
    let turn = angle(at) - angle(from);
    turn -= 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    put(0, first(0) + turn, TURN);
  } else {
    for (const way of [0, 1]) put(way, first(way) + at[way] - from[way], 1e-3);
  }
  return values;
}

// A value on the grid that is chosen, of so many `step`; a free one has twelve digits.
function snapped(value, step) {
  const grid = Number(document.getElementById("snap").value) * step;
  return grid > 0 ? Math.round(value / grid) * grid : value;
}

const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

function key(event) {
  const handle = handleAt(event), way = KEYS[event.key];
  if (!handle || !way || !page.answer || page.held) return;
  event.preventDefault();
  if (page.searching) return;
  const grid = Number(document.getElementById("snap").value) || 0.1;
  const by = grid * (event.shiftKey ? 10 : 1), values = {};
  const single = handle.names.length === 1;
  handle.names.forEach((names, k) => {
    const sign = single ? way[0] + way[1] : way[k];
    const step = by * (handle.kind === "arm" ? TURN : 1e-3);
    if (sign) for (const name of names) values[name] = page.view.numbers[name] + sign * step;
  });
  page.view = predicted(page.answer, { ...page.view.numbers, ...values });
  redraw();
  say({ do: "set", values, what: `moved the ${handle.label}` });
}

// Exact values of what is selected.
export function showExact() {
  const form = document.getElementById("exact");
  const handle = page.drive && page.drive.handles.find((one) => one.key === page.selected);
  if (!handle) return form.replaceChildren();
  form.replaceChildren(element("strong", {}, handle.label), ...handle.names.map((names) => field(names)));
}

export function field(names) {
  const about = page.drive.numbers.find((one) => one.name === names[0]);
  const [factor, shown] = unit(about.unit);
  const input = element("input", { inputmode: "decimal", "data-number": names[0], "aria-label": `${names[0]} in ${shown || "1"}`, title: about.about });
  input.value = written(page.view.numbers[names[0]] * factor);
  input.addEventListener("keydown", (event) => { if (event.key === "Enter") { event.preventDefault(); input.blur(); } });
  input.addEventListener("change", () => {
    const value = Number(input.value.replace("−", "-").trim());
    if (input.value.trim() === "" || !Number.isFinite(value)) {
      input.setCustomValidity("give a number");
      input.reportValidity();
      return;
    }
    input.setCustomValidity("");
    say({ do: "set", values: Object.fromEntries(names.map((name) => [name, value / factor])), what: `set ${names[0]}` });
  });
  return element("label", {}, `${names[0].split(".").slice(-2).join(" ")} `, input, ` ${shown}`);
}

export const written = (value) => String(Number(value.toPrecision(12)));

export function refreshFields() {
  for (const input of document.querySelectorAll("input[data-number]")) {
    if (input === document.activeElement) continue;
    const about = page.drive.numbers.find((one) => one.name === input.dataset.number);
    input.value = written(page.view.numbers[about.name] * unit(about.unit)[0]);
  }
}
