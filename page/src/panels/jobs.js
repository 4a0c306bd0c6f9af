// The tab "Jobs": what runs, how far it has come, and a button to cancel it.

import { Code } from "../wire/rpc.js";
import { count, duration, el, replace, table, time } from "../dom.js";

/** Jobs that are shown. */
const PAGE_SIZE = 50;
/** A JobState below this one has not ended. */
const SUCCEEDED = 3;

export class JobsPanel {
  constructor(app) {
    this.app = app;
    this.title = "Jobs";
    this.node = el("div");
  }

  update() {}

  async refresh(signal) {
    const { client } = this.app;
    let jobs;
    try {
      ({ jobs } = await client.call("JobService", "ListJobs", { pageSize: PAGE_SIZE }, signal));
    } catch (error) {
      if (error.code === Code.CANCELLED) return;
      const text = error.code === Code.UNIMPLEMENTED ? "This server has no jobs." : error.message;
      replace(this.node, el("p", { className: "note" }, text));
      return;
    }
    const columns = [{ name: "Job" }, { name: "Progress" }, { name: "" }];
    const rows = jobs.map((job) => [this.#what(job), this.#progress(job), this.#cancel(job)]);
    replace(
      this.node,
      rows.length > 0
        ? table("The newest jobs", columns, rows)
        : el("p", { className: "note" }, "No jobs. covis job submit makes one."),
    );
  }

  #what(job) {
    const { case: kind, value } = job.spec?.spec ?? {};
    const name = kind === "reconstruct" ? "rebuild" : (kind ?? "unknown");
    const words = name.replace(/[A-Z]/g, (letter) => ` ${letter.toLowerCase()}`);
    const map = value?.mapId || value?.targetMapId || value?.sourceMapId || "";
    const when = time(job.createTime);
    return el("span", {}, job.jobId, el("small", {}, `${words} ${map}, ${when}`));
  }

  #progress(job) {
    const state = this.app.descriptors.enumText("JobState", job.state);
    const { phase, share, iteration, timeLeftS } = job.progress ?? {};
    const details = [phase];
    if (iteration) details.push(`iteration ${count(iteration.iteration)}`);
    const isOpen = job.state < SUCCEEDED;
    if (isOpen && timeLeftS !== undefined) details.push(`${duration(timeLeftS)} left`);
    if (job.failure) details.push(job.failure.message);
    const bar = isOpen ? el("progress", { "aria-label": `Progress of ${job.jobId}`, max: 1 }) : null;
    if (bar && share !== undefined) bar.value = share;
    const percent = isOpen && share !== undefined ? `${Math.round(share * 100)} %, ` : "";
    return el("span", {}, `${percent}${state}`, bar, el("small", {}, details.filter(Boolean).join(", ")));
  }

  #cancel(job) {
    if (job.state >= SUCCEEDED) return "";
    const cancel = async (event) => {
      event.currentTarget.disabled = true;
      try {
        await this.app.client.call("JobService", "CancelJob", { jobId: job.jobId });
      } catch (error) {
        this.app.report(error);
      }
    };
    return el("button", {
      type: "button",
      "data-key": `cancel-${job.jobId}`,
      "aria-label": `Cancel ${job.jobId}`,
      disabled: job.cancelRequested,
      onclick: cancel,
    }, job.cancelRequested ? "Canceling" : "Cancel");
  }
}
