// Tabs, as the ARIA Authoring Practices describe them: arrow keys go from one to the next.

import { byId, el } from "../dom.js";

export class Tabs {
  /** `tabs`: a panel for each name. `onShow(name)` is told which one is shown. */
  constructor(tabs, onShow) {
    this.names = Object.keys(tabs);
    this.onShow = onShow;
    this.buttons = this.names.map((name, k) =>
      el("button", {
        type: "button",
        role: "tab",
        id: `tab-${name}`,
        "aria-controls": `panel-${name}`,
        onclick: () => this.show(name),
        onkeydown: (event) => this.#key(event, k),
      }, tabs[name].title),
    );
    byId("tabs").append(...this.buttons);
    for (const name of this.names) {
      const { node } = tabs[name];
      node.id = `panel-${name}`;
      node.tabIndex = 0;
      node.setAttribute("role", "tabpanel");
      node.setAttribute("aria-labelledby", `tab-${name}`);
      byId("panels").append(node);
    }
    this.show(this.names[0]);
  }

  show(name) {
    this.shown = name;
    this.names.forEach((other, k) => {
      const isShown = other === name;
      this.buttons[k].setAttribute("aria-selected", String(isShown));
      this.buttons[k].tabIndex = isShown ? 0 : -1;
      byId(`panel-${other}`).hidden = !isShown;
    });
    this.onShow(name);
  }

  #key(event, k) {
    const places = { ArrowRight: k + 1, ArrowLeft: k - 1, Home: 0, End: this.names.length - 1 };
    if (!(event.key in places)) return;
    event.preventDefault();
    const next = (places[event.key] + this.names.length) % this.names.length;
    this.show(this.names[next]);
    this.buttons[next].focus();
  }
}
