// What the page knows: the drive, the last true answer, and what is shown now.

export const page = {
  drive: null, // names, handles, limits: what does not change while something is dragged
  answer: null, // the last true one, with its derivatives
  good: null, // the last one of a layout that can be built
  starts: {}, // those of the file as it was opened, by operating point
  start: null, // that of the point which is shown
  began: null, // its objective
  curves: null, // frequencies over speed
  contact: null, // arcs, of the design for which they were asked
  view: null, // what is shown: the answer, or what its derivatives make of it
  held: null, // the drag that goes on
  selected: null, // key of a handle
  before: null, // the design before a search
  preview: null, // the design that a search is at
  bands: false,
};

export function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Float64Array(bytes.buffer);
}

// A view of an answer: its numbers, as they are.
export function seen(answer) {
  return {
    flat: answer.values,
    objective: answer.objective,
    limits: answer.limits.map((one) => one.value),
    numbers: answer.numbers,
    fault: answer.fault,
    true: true,
  };
}

// What the derivatives say of numbers that differ a little from the answer's.
export function predicted(answer, values) {
  const names = Object.keys(answer.numbers), count = names.length;
  const steps = [];
  names.forEach((name, k) => {
    if (name in values && values[name] !== answer.numbers[name]) {
      steps.push([k, values[name] - answer.numbers[name]]);
    }
  });
  const gained = (row) => steps.reduce((sum, [k, by]) => sum + answer.slopes[row * count + k] * by, 0);
  const plus = (value, row) => (value === null ? null : value + gained(row));
  const size = answer.values.length;
  return {
    flat: answer.values.map((value, row) => plus(value, row)),
    objective: plus(answer.objective, size),
    limits: answer.limits.map((one, k) => plus(one.value, size + 1 + k)),
    numbers: { ...answer.numbers, ...values },
    fault: answer.fault,
    true: steps.length === 0,
  };
}

export function part(view, name) {
  const [start, size] = page.answer.fields[name];
  return view.flat.slice(start, start + size);
}

export function points(view, name) {
  const flat = part(view, name), found = [];
  for (let k = 0; k < flat.length; k += 2) found.push([flat[k], flat[k + 1]]);
  return found;
}

const UNITS = { m: [1e3, "mm"], rad: [180 / Math.PI, "°"], "rad/s": [30 / Math.PI, "rpm"] };

export function unit(si, hertz = false) {
  if (si === "rad/s" && hertz) return [1 / (2 * Math.PI), "Hz"];
  return UNITS[si] || [1, si];
}

export function digits(value, count = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1e6 || (size > 0 && size < 1e-4)) return value.toExponential(count - 1);
  const decimals = Math.max(0, Math.min(6, count - 1 - Math.floor(Math.log10(Math.max(size, 1e-3)))));
  return value.toFixed(decimals).replace("-", "−");
}

export function element(kind, attributes = {}, ...inside) {
  return filled(document.createElement(kind), attributes, inside);
}

export function drawn(kind, attributes = {}, ...inside) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", kind), attributes, inside);
}

function filled(made, attributes, inside) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...inside.filter((one) => one !== null && one !== undefined));
  return made;
}
