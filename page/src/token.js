// The bearer token: typed into a dialog, kept in this tab's session only.

import { byId } from "./dom.js";

const KEY = "covis-token";

export class Token {
  /** `onChange` is called when another one was typed in. */
  constructor(onChange) {
    this.dialog = byId("token-dialog");
    this.input = byId("token");
    this.isAsked = false;
    byId("token-open").addEventListener("click", () => this.#open(""));
    byId("token-close").addEventListener("click", () => this.dialog.close());
    byId("token-form").addEventListener("submit", (event) => {
      event.preventDefault();
      sessionStorage.setItem(KEY, this.input.value.trim());
      this.input.value = "";
      this.isAsked = false;
      byId("token-error").textContent = "";
      onChange();
    });
  }

  get value() {
    return sessionStorage.getItem(KEY);
  }

  /** Asks for one because a call was refused. */
  ask(reason) {
    this.isAsked = true;
    this.#open(this.value ? `Refused: ${reason}` : "");
  }

  /** The server has admitted a call. */
  accepted() {
    this.isAsked = false;
    if (this.dialog.open && this.value) this.dialog.close();
  }

  #open(error) {
    byId("token-error").textContent = error;
    if (!this.dialog.open) this.dialog.showModal();
  }
}
