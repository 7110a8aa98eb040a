// The numbers beside the picture. Each cell that a machine may check holds its value in data-value.

import { page, seen, part, points, element, drawn, digits, unit } from "./state.js";
import { chart } from "./chart.js";
import { field } from "./drag.js";

const at = (id) => document.getElementById(id);
const cell = (value, shown, key) => element("td", { "data-value": value, "data-key": key }, shown);

export function panels() {
  if (!page.view || !page.drive) return;
  // Of a layout that cannot be built the numbers of the last one that can be are kept.
  const kept = page.view.fault !== null;
  page.told = kept ? page.good : page.answer;
  if (!page.told) return at("objective").replaceChildren(element("p", {}, "There are no numbers before there is a layout that can be built."));
  const view = kept ? seen(page.good) : page.view;
  objective(view, kept);
  limits(view);
  warnings();
  gamma(view);
  chart(at("speeds"), view);
  spans(view);
  pulleys(view);
  movers();
}

// Half the width of the band of an entry, 3 deviations; null where none is shown.
const band = (row) => (page.bands && page.told.bands ? 3 * page.told.bands[row] : null);
const around = (row, factor = 1) => {
  const wide = band(row);
  return wide === null ? "" : ` ± ${digits(wide * factor, 2)}`;
};
const rowOf = (name, k = 0) => page.told.fields[name][0] + k;

function objective(view, kept) {
  const size = page.told.values.length, start = page.began;
  const gained = view.objective !== null && start !== null ? view.objective - start : null;
  const words = page.drive.objective.map((one) => (one.weight === 1 ? one.name : `${digits(one.weight, 3)} ${one.name}`)).join(" + ");
  at("objective").replaceChildren(
    element("h2", {}, `Objective: ${words}`),
    element("span", { class: "big", "data-value": view.objective, "data-key": "objective" }, digits(view.objective, 6) + around(size)),
    element("span", { class: gained > 0 ? "bad" : "good" }, gained === null ? "" : `  ${gained > 0 ? "+" : ""}${digits(gained, 4)} since opened`),
    element("p", { class: "quiet", "data-prediction": !view.true }, kept ? "Numbers of the last layout that can be built."
      : page.told.judged === "pending" ? "The objective and the limits are being compiled; the rest is true."
      : page.told.judged === "predicted" ? "Limits by their last derivatives: the true ones take longer."
      : view.true ? "True values." : "By the derivatives of the last true values."),
  );
}

function limits(view) {
  if (!page.told.limits.length) return at("limits").replaceChildren();
  const rows = page.told.limits.map((one, k) => {
    const [factor, shown] = unit(one.unit, true), value = view.limits[k];
    let distance = null, state = "unknown";
    if (value !== null) {
      distance = Math.min(one.lower === null ? Infinity : value - one.lower, one.upper === null ? Infinity : one.upper - value);
      state = distance < -1e-9 * one.size ? "missed" : distance < 0.05 * one.size ? "near" : "met";
    }
    const size = page.told.values.length + 1 + k;
    const range = `${one.lower === null ? "" : digits(one.lower * factor, 4)} … ${one.upper === null ? "" : digits(one.upper * factor, 4)}`;
    return element("tr", { "data-limit": one.quantity, "data-state": state },
      element("td", {}, element("span", { class: `lamp ${state}`, role: "img", "aria-label": state }), ` ${one.quantity}${one.implied ? " (to be built)" : ""}`),
      cell(value, value === null ? "–" : digits(value * factor, 4) + around(size, factor), `limit:${one.quantity}`),
      element("td", {}, range),
      element("td", { class: state === "missed" ? "bad" : "", "data-value": distance }, distance === null ? "–" : digits(Math.abs(distance) < 1e-9 * one.size ? 0 : distance * factor, 3)),
      element("td", { class: "text" }, shown));
  });
  at("limits").replaceChildren(element("h2", {}, "Limits"), table(["quantity", "value", "limits", "distance", ""], rows));
}

function gamma(view) {
  const each = part(view, "coupling"), start = page.start ? part({ flat: page.start.values }, "coupling") : each;
  const most = Math.max(...each, ...start, 1e-9) * 1.15, wide = 170, rows = each.map((value, k) => {
    const bar = drawn("svg", { width: wide, height: 14, "aria-hidden": true },
      drawn("rect", { class: "bar", x: 0, y: 2, width: Math.max(0, (wide * value) / most), height: 10 }),
      drawn("line", { class: "bar-start", x1: (wide * start[k]) / most, x2: (wide * start[k]) / most, y1: 0, y2: 14 }));
    const off = band(rowOf("coupling", k));
    if (off !== null) bar.append(drawn("line", { class: "bar-band", x1: Math.max(0, (wide * (value - off)) / most), x2: (wide * (value + off)) / most, y1: 7, y2: 7 }));
    return element("tr", {}, element("td", {}, page.drive.spans[k]), cell(value, digits(value, 4) + around(rowOf("coupling", k)), `coupling:${k}`), element("td", {}, bar));
  });
  const total = part(view, "coupling_total")[0], eta = part(view, "effectiveness");
  rows.push(element("tr", {}, element("td", {}, element("strong", {}, "all spans")), cell(total, digits(total, 5) + around(rowOf("coupling_total")), "coupling_total"), element("td", {})));
  eta.forEach((value, k) => rows.push(element("tr", {}, element("td", {}, `tensioner effectiveness${eta.length > 1 ? ` of ${page.drive.belts[k].name}` : ""}`),
    cell(value, digits(value, 4) + around(rowOf("effectiveness", k)), `effectiveness:${k}`), element("td", {}))));
  at("gamma").replaceChildren(element("h2", {}, "Coupling indicator Gamma by span"), table(["span", "Gamma", ""], rows),
    element("p", { class: "quiet" }, "Orange line: as opened."));
}

function spans(view) {
  const names = ["tensions", "rest_tensions", "span_lengths", "meter"], factors = [1, 1, 1e3, 1];
  const columns = names.map((name) => part(view, name));
  const rows = page.drive.spans.map((name, k) => element("tr", {}, element("td", {}, name),
    ...columns.map((values, c) => cell(values[k], digits(values[k] * factors[c], 4) + around(rowOf(names[c], k), factors[c]), `${names[c]}:${k}`))));
  at("spans").replaceChildren(element("h2", {}, "Spans"), table(["span", "running N", "at rest N", "length mm", "meter Hz"], rows),
    element("p", { class: "quiet", "data-value": part(view, "gap")[0], "data-key": "gap" }, `Least gap between rims and belt: ${digits(1e3 * part(view, "gap")[0], 4)} mm.`));
}

function pulleys(view) {
  const wraps = part(view, "wraps"), loads = points(view, "hub_loads"), used = part(view, "slip_exponents"), radii = part(view, "radii");
  const rows = page.drive.pulleys.map((one, k) => {
    const load = Math.hypot(...loads[k]), margin = one.friction === null ? null : one.friction * wraps[k] - used[k];
    return element("tr", {}, element("td", {}, one.name), cell(radii[k], digits(1e3 * radii[k], 5), `radii:${k}`),
      cell(wraps[k], digits((wraps[k] * 180) / Math.PI, 4) + around(rowOf("wraps", k), 180 / Math.PI), `wraps:${k}`),
      cell(load, digits(load, 4), `hub_loads:${k}`), cell(margin, margin === null ? "–" : digits(margin, 3), `slip_margin:${k}`));
  });
  at("pulleys").replaceChildren(element("h2", {}, "Pulleys"), table(["pulley", "radius mm", "wrap °", "hub load N", "slip margin"], rows));
}

function movers() {
  const rows = page.told.movers.map((one) => element("tr", {}, element("td", {}, one.name), cell(one.change, `${one.change > 0 ? "+" : ""}${digits(one.change, 3)}`, `mover:${one.name}`), element("td", {}, `per ${one.per}`)));
  at("movers").replaceChildren(element("h2", {}, "What moves the objective most"), table(["number", "change", ""], rows));
}

function warnings() {
  const texts = page.told.warnings;
  at("warnings").replaceChildren(...(texts.length ? [element("h2", {}, "Warnings"), ...texts.map((text) => element("p", { class: "warning" }, text))] : []));
}

function table(heads, rows) {
  return element("table", {}, element("thead", {}, element("tr", {}, ...heads.map((text) => element("th", { scope: "col" }, text)))), element("tbody", {}, ...rows));
}

// Every number with its exact value, made once for a drive.
export function allNumbers() {
  const scroll = element("div", { class: "scroll" }, ...page.drive.numbers.map((one) => element("p", {}, field([one.name]), element("span", { class: "quiet" }, ` ${one.name}`))));
  at("all").replaceChildren(element("details", {}, element("summary", {}, "All numbers"), scroll));
}

export function searchPanel(found) {
  const box = at("search");
  box.hidden = false;
  const lines = [element("h2", {}, "Search"), element("p", { id: "search-text" }, found.text)];
  if (found.values) {
    const rows = found.values.map((one) => {
      const [factor, shown] = unit(one.unit);
      return element("tr", {}, element("td", {}, one.name), element("td", {}, digits(one.before * factor, 5)), cell(one.after, digits(one.after * factor, 5), `after:${one.name}`), element("td", { class: "text" }, shown));
    });
    lines.push(table(["variable", "before", "after", ""], rows));
  }
  if (found.path && found.path.length > 1) lines.push(progress(found.path));
  box.replaceChildren(...lines);
}

function progress(path) {
  const wide = 300, high = 60, low = Math.min(...path), size = Math.max(...path) - low || 1;
  const line = path.map((value, k) => `${(wide * k) / (path.length - 1)},${4 + (high - 8) * (1 - (value - low) / size)}`).join(" ");
  return drawn("svg", { viewBox: `0 0 ${wide} ${high}`, width: wide, height: high, role: "img", "aria-label": "objective over the iterations" },
    drawn("polyline", { points: line, fill: "none", stroke: "#0072b2", "stroke-width": 2 }));
}

const WORDS = { center: ["centers and pivots", 1e3, "mm"], radius: ["radii", 1e3, "mm"], angle: ["arm's angle", 180 / Math.PI, "°"], tension: ["tension", 100, "%"] };

// The standard deviations behind the band; those of a study with tolerances are the study's.
export function tolerancePanel(say) {
  const box = at("tolerances");
  box.hidden = !page.bands;
  if (box.hidden) return;
  const head = element("h2", {}, "Tolerances: bands of 3 standard deviations, by the derivatives");
  if (!page.drive.tolerances) {
    box.replaceChildren(head, element("p", { class: "quiet" }, `Those of the study: ${page.drive.tolerated.join(", ")}.`));
    return;
  }
  const fields = Object.entries(WORDS).map(([word, [label, factor, shown]]) => {
    const input = element("input", { class: "field", inputmode: "decimal", "data-tolerance": word, "aria-label": `standard deviation of ${label} in ${shown}` });
    input.value = String(Number((page.drive.tolerances[word] * factor).toPrecision(6)));
    input.addEventListener("change", () => {
      page.drive.tolerances[word] = Number(input.value) / factor;
      say({ do: "bands", on: true, sizes: page.drive.tolerances });
    });
    return element("p", {}, element("label", {}, `${label} `, input, ` ${shown}`));
  });
  box.replaceChildren(head, ...fields);
}
