// Making elements. Text becomes text and never markup.

/** An element with properties, `aria-*` and `data-*` attributes, and children. */
export function el(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name in node && !name.includes("-")) node[name] = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return node;
}

export const byId = (id) => document.getElementById(id);

/** A list of terms and what they are. */
export function terms(pairs) {
  return el("dl", {}, pairs.map(([term, value]) => [el("dt", {}, term), el("dd", {}, String(value))]));
}

/** A table; a column with `number` is aligned to the right. */
export function table(caption, columns, rows) {
  const cellClass = (k) => (columns[k].number ? "number" : "");
  const head = columns.map(({ name }, k) => el("th", { scope: "col", className: cellClass(k) }, name));
  const cells = (row) => row.map((cell, k) => el("td", { className: cellClass(k) }, cell));
  return el(
    "table",
    {},
    el("caption", {}, caption),
    el("thead", {}, el("tr", {}, head)),
    el("tbody", {}, rows.map((row) => el("tr", {}, cells(row)))),
  );
}

/**
 * Puts other children in the place of those of `node`, unless they look the same. What has the focus
 * keeps it where it has a `data-key`.
 */
export function replace(node, ...children) {
  const next = el("div", {}, ...children);
  if (next.innerHTML === node.innerHTML) return;
  const focused = node.contains(document.activeElement) ? document.activeElement.dataset.key : null;
  node.replaceChildren(...next.childNodes);
  if (focused) node.querySelector(`[data-key="${CSS.escape(focused)}"]`)?.focus();
}

/** Says something to whoever cannot see it. */
export function say(text) {
  byId("said").textContent = text;
}

const grouped = new Intl.NumberFormat("en");
/** A count for people. */
export const count = (value) => grouped.format(value);

/** A size for people. */
export function bytes(value) {
  const units = ["B", "KiB", "MiB", "GiB"];
  let size = Number(value);
  let unit = 0;
  while (size >= 1024 && unit < units.length - 1) {
    size /= 1024;
    unit++;
  }
  return `${unit === 0 ? size : size.toFixed(1)} ${units[unit]}`;
}

/** A Timestamp as local time. */
export function time(timestamp) {
  if (!timestamp) return "";
  return new Date(Number(timestamp.seconds) * 1000).toLocaleTimeString();
}

/** A duration for people: seconds, from two minutes on minutes, from two hours on hours. */
export function duration(seconds) {
  const [size, unit] = [[3600, "h"], [60, "min"]].find(([size]) => seconds >= 2 * size) ?? [1, "s"];
  return `${count(Math.ceil(seconds / size))} ${unit}`;
}
