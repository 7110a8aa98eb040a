// The page: what the server says, and what is done on the page.

import { page, seen, predicted, unpacked, element } from "./state.js";
import { draw, fit } from "./layout.js";
import { begin as beginDragging, showExact, refreshFields } from "./drag.js";
import { panels, allNumbers, searchPanel, tolerancePanel } from "./panels.js";
import { forgetSettings } from "./chart.js";

const at = (id) => document.getElementById(id);
page.sentAt = new Map();
page.delays = []; // from the pointer's move to the true answer on the page [ms]
let socket = null, waiting = false, told = 0;
const EASE = 60; // [ms] between two drawings of the tables while something is dragged

const CHANGES = ["begin", "set", "undo", "redo", "case", "open"];

function say(message) {
  if (CHANGES.includes(message.do)) page.before = null;
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function redraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    draw();
    // The picture follows the pointer at every frame, the tables as fast as they are read.
    const now = performance.now();
    if (page.held && now - told < EASE) {
      clearTimeout(page.later);
      page.later = setTimeout(redraw, EASE);
      return;
    }
    told = now;
    panels();
    refreshFields();
  });
}
page.changed = redraw;

function status(text) {
  if (at("status").textContent !== text) at("status").textContent = text;
}

function complain(text) {
  at("error").textContent = text;
  at("error").hidden = !text;
}

const heard = {
  status: ({ text }) => status(text),
  error: ({ text }) => complain(text),
  drive(drive) {
    Object.assign(page, { drive, answer: null, good: null, starts: {}, curves: null, contact: null, view: null, held: null, selected: null, before: null, searching: false });
    page.orders = drive.view?.orders ?? drive.orders;
    page.idle = drive.view?.idle ?? (drive.idle * 30) / Math.PI;
    page.case = drive.case ?? 0;
    forgetSettings();
    for (const [id, value] of Object.entries(drive.view?.shown ?? {})) if (at(id)) at(id).checked = value;
    if (drive.view?.snap !== undefined) at("snap").value = drive.view.snap;
    page.bands = at("show-bands").checked;
    at("title").textContent = `${drive.name} · beltjax studio`;
    document.title = `${drive.name} · beltjax studio`;
    at("search").hidden = true;
    at("all").replaceChildren();
    at("exact").replaceChildren();
    at("layout").querySelector(".handles").replaceChildren();
    at("optimize").disabled = !drive.isStudy;
    at("optimize").title = drive.isStudy ? "" : "Open a study: it says what may change and what must hold.";
    at("show-contact").disabled = !drive.contact;
    tabs();
    status("compiling for this drive; the first time on a machine takes a minute");
    page.fresh = true;
    page.began = null;
    page.start = null;
  },
  answer(answer) {
    answer.slopes = unpacked(answer.slopes);
    page.answer = answer;
    page.case = answer.case;
    if (!answer.fault) page.good = answer;
    // Each operating point as it was when nothing had been changed yet.
    if (!answer.undo && !answer.moving && !answer.fault) page.starts[answer.case] = answer;
    page.start = page.starts[answer.case];
    if (!answer.undo) page.began = page.began ?? answer.objective;
    if (answer.of && page.sentAt.has(answer.of)) {
      page.delays.push(performance.now() - page.sentAt.get(answer.of));
      for (const one of [...page.sentAt.keys()]) if (one <= answer.of) page.sentAt.delete(one);
    }
    // While the pointer goes on, the new derivatives say what is there now.
    const held = page.held;
    page.view = held && held.moved && held.values ? predicted(answer, held.values) : seen(answer);
    if (!answer.moving) page.contact = null;
    fault(answer.fault ? answer.fault.text : "");
    complain("");
    at("undo").disabled = !answer.undo;
    at("redo").disabled = !answer.redo;
    at("undo").title = answer.undo ? `Undo: ${answer.undo}` : "";
    at("redo").title = answer.redo ? `Redo: ${answer.redo}` : "";
    status(answer.judged === "pending" ? "compiling the objective and the limits" : `answered in ${Math.round(answer.took)} ms`);
    document.body.classList.toggle("stale", answer.fault !== null);
    if (page.fresh) {
      page.fresh = false;
      fit();
      allNumbers();
      showExact();
      tolerancePanel(say);
      if (page.bands) say({ do: "bands", on: true, sizes: page.drive.tolerances ?? {} });
    }
    tabs();
    if (!answer.moving && at("show-contact").checked && !answer.fault) say({ do: "contact" });
    redraw();
  },
  diagnosis: ({ text }) => fault(text),
  ready: () => { if (!page.held) say({ do: "show" }); },
  curves(curves) {
    page.curves = { ...curves, numbers: page.answer.numbers };
    redraw();
  },
  contact({ pieces }) {
    page.contact = pieces;
    redraw();
  },
  search(found) {
    if (found.state === "begun") page.before = page.good;
    page.searching = found.state !== "ended";
    at("stop").hidden = found.state === "ended";
    at("optimize").disabled = found.state !== "ended" || !page.drive.isStudy;
    searchPanel(found);
    redraw();
  },
  file({ name, mime, content }) {
    const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
    const address = URL.createObjectURL(new Blob([bytes], { type: mime }));
    const link = element("a", { href: address, download: name });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
    status(`saved ${name}`);
  },
};

function fault(text) {
  at("fault").textContent = text ? `Not possible: ${text}` : "";
  at("fault").hidden = !text;
}

function tabs() {
  const names = page.drive.cases;
  if (names.length < 2) return at("tabs").replaceChildren();
  if (at("tabs").childElementCount !== names.length) {
    at("tabs").replaceChildren(...names.map((name, k) => {
      const one = element("button", { role: "tab", "data-case": k }, name);
      one.addEventListener("click", () => say({ do: "case", case: k }));
      one.addEventListener("keydown", (event) => {
        const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (by) at("tabs").children[(k + by + names.length) % names.length].focus();
      });
      return one;
    }));
  }
  [...at("tabs").children].forEach((one, k) => {
    one.setAttribute("aria-selected", k === page.case);
    one.tabIndex = k === page.case ? 0 : -1;
  });
}

// What of the page is not the design: it is kept in the page's file.
function viewState() {
  const shown = Object.fromEntries([...document.querySelectorAll("#tools input[type=checkbox]")].map((one) => [one.id, one.checked]));
  return { shown, snap: at("snap").value, orders: page.orders, idle: page.idle };
}

function listen() {
  at("undo").addEventListener("click", () => say({ do: "undo" }));
  at("redo").addEventListener("click", () => say({ do: "redo" }));
  at("fit").addEventListener("click", () => { fit(); redraw(); });
  at("optimize").addEventListener("click", () => say({ do: "optimize", all: at("all-starts").checked }));
  at("stop").addEventListener("click", () => say({ do: "stop" }));
  at("save").addEventListener("change", () => {
    const kind = at("save").value;
    at("save").value = "";
    if (kind) say({ do: "save", kind, view: viewState() });
  });
  at("open").addEventListener("change", async () => {
    const files = {};
    for (const one of at("open").files) files[one.name] = await one.text();
    at("open").value = "";
    if (Object.keys(files).length) say({ do: "open", files });
  });
  for (const id of ["show-arrows", "show-loads", "show-wraps", "show-start"]) at(id).addEventListener("change", redraw);
  at("show-contact").addEventListener("change", () => { if (at("show-contact").checked) say({ do: "contact" }); redraw(); });
  at("show-bands").addEventListener("change", () => {
    page.bands = at("show-bands").checked;
    tolerancePanel(say);
    say({ do: "bands", on: page.bands, sizes: page.drive.tolerances ?? {} });
  });
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.target.matches("input")) return;
    const letter = event.key.toLowerCase();
    if (letter !== "z" && letter !== "y") return;
    event.preventDefault();
    say({ do: letter === "y" || event.shiftKey ? "redo" : "undo" });
  });
  new ResizeObserver(redraw).observe(at("layout"));
  beginDragging(say, redraw);
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    heard[message.is]?.(message);
  });
  socket.addEventListener("close", () => {
    status("the server has stopped; start it again and reload this page");
    for (const one of document.querySelectorAll("#tools button")) one.disabled = true;
  });
}

listen();
connect();
globalThis.studio = page; // for tests and for those who are curious
