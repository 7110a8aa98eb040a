// Natural frequencies over the driver's speed, with orders and the idle line.

import { page, part, drawn, element, digits } from "./state.js";

const WIDE = 420, HIGH = 250, LEFT = 38, BOTTOM = 30, TOP = 8, RIGHT = 20;
const RPM = 30 / Math.PI;

// The curves as they are, or what the derivatives by the numbers of what is dragged make of them.
function curves(view) {
  const { hertz, slopes, handle, numbers } = page.curves;
  const dragged = page.drive.handles.find((one) => one.key === handle);
  if (!dragged) return hertz;
  const steps = dragged.names.map((names) => view.numbers[names[0]] - numbers[names[0]]);
  return hertz.map((row, s) => row.map((value, m) => (value === null ? null : value + steps.reduce((sum, by, d) => sum + by * slopes[d][s][m], 0))));
}

export function chart(box, view) {
  if (!page.curves) return box.replaceChildren();
  const hertz = curves(view), speeds = page.curves.speeds.map((one) => one * RPM);
  const orders = page.orders, idle = page.idle, here = page.told.driver_speed * RPM;
  const right = speeds[speeds.length - 1], all = hertz.flat().filter((value) => value !== null);
  const top = 1.05 * Math.max(...all, 1);
  const x = (rpm) => LEFT + ((WIDE - LEFT - RIGHT) * rpm) / right, y = (value) => HIGH - BOTTOM - ((HIGH - BOTTOM - TOP) * value) / top;
  const svg = drawn("svg", { class: "chart", viewBox: `0 0 ${WIDE} ${HIGH}`, width: "100%", role: "img", "aria-label": "Natural frequencies over the driver's speed, with orders" });
  for (const value of ticks(top)) svg.append(drawn("line", { class: "grid", x1: LEFT, x2: WIDE - RIGHT, y1: y(value), y2: y(value) }), drawn("text", { x: LEFT - 4, y: y(value) + 4, "text-anchor": "end" }, String(value)));
  for (const value of ticks(right)) svg.append(drawn("text", { x: x(value), y: HIGH - BOTTOM + 14, "text-anchor": "middle" }, String(value)));
  svg.append(drawn("path", { class: "axis", d: `M${LEFT} ${TOP}V${HIGH - BOTTOM}H${WIDE - RIGHT}` }));
  svg.append(drawn("text", { x: WIDE - RIGHT, y: HIGH - 4, "text-anchor": "end" }, "driver rpm"), drawn("text", { x: LEFT + 4, y: TOP + 10 }, "Hz"));
  for (const order of orders) {
    const end = Math.min(right, (top * 60) / order);
    svg.append(drawn("line", { class: "order", x1: x(0), y1: y(0), x2: x(end), y2: y((order * end) / 60), "data-order": order }), drawn("text", { x: x(end) - 4, y: y((order * end) / 60) + 14, "text-anchor": "end" }, `order ${order}`));
  }
  svg.append(drawn("line", { class: "idle", x1: x(idle), x2: x(idle), y1: TOP, y2: HIGH - BOTTOM, "data-idle": idle }), drawn("text", { x: x(idle) + 3, y: HIGH - BOTTOM - 4 }, "idle"));
  svg.append(drawn("line", { class: "now", x1: x(here), x2: x(here), y1: TOP, y2: HIGH - BOTTOM }));
  const modes = hertz[0].length;
  for (let m = 0; m < modes; m += 1) {
    const line = hertz.map((row, s) => [speeds[s], row[m]]).filter(([, value]) => value !== null);
    svg.append(drawn("polyline", { class: "mode", points: line.map(([rpm, value]) => `${x(rpm)},${y(value)}`).join(" ") }));
  }
  const now = part(view, "frequencies"), start = page.told.fields.frequencies[0];
  now.forEach((value, k) => {
    if (page.bands && page.told.bands) {
      const off = 3 * page.told.bands[start + k];
      svg.append(drawn("line", { class: "band", x1: x(here), x2: x(here), y1: y(value - off), y2: y(value + off) }));
    }
    svg.append(drawn("circle", { class: "dot", cx: x(here), cy: y(value), r: 2.6, "data-key": `frequencies:${k}`, "data-value": value }));
  });
  box.replaceChildren(element("h2", {}, "Natural frequencies over the driver's speed"), svg,
    element("p", { class: "quiet" }, `At ${digits(here, 4)} rpm: ${now.map((value) => digits(value, 4)).join(", ")} Hz. ${nearest(now, here, orders)}`),
    settings());
}

// Which frequency an order comes closest to at this speed.
function nearest(now, rpm, orders) {
  let best = null;
  for (const order of orders) for (const value of now) {
    const forced = (order * rpm) / 60, off = Math.abs(value - forced);
    if (forced && (!best || off < best.off)) best = { off, order, value, forced };
  }
  return best ? `Order ${best.order} (${digits(best.forced, 4)} Hz) is ${digits(best.off, 3)} Hz from ${digits(best.value, 4)} Hz.` : "";
}

let kept = null;

function settings() {
  if (kept) return kept;
  const orders = element("input", { class: "field", id: "orders", "aria-label": "orders of the driver, by commas" });
  const idle = element("input", { class: "field", id: "idle", inputmode: "decimal", "aria-label": "idle speed in rpm" });
  orders.value = page.orders.join(", ");
  idle.value = String(Math.round(page.idle));
  orders.addEventListener("change", () => {
    const found = orders.value.split(/[,;\s]+/).filter(Boolean).map(Number).filter((one) => one > 0 && Number.isFinite(one));
    if (found.length) page.orders = found;
    page.changed();
  });
  idle.addEventListener("change", () => {
    if (Number(idle.value) > 0) page.idle = Number(idle.value);
    page.changed();
  });
  kept = element("p", {}, element("label", {}, "orders ", orders), element("label", {}, " idle rpm ", idle));
  return kept;
}

export function forgetSettings() {
  kept = null;
}

function ticks(top) {
  const rough = top / 5, size = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * size).find((one) => one >= rough);
  const found = [];
  for (let value = 0; value <= top; value += step) found.push(Number(value.toPrecision(6)));
  return found;
}
