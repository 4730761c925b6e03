"use strict";
// Sorting, filtering, copying and stepping. Without it the page shows the same tables and figures, unsorted and last.
(() => {
  const order = new Intl.Collator("en", { numeric: true });

  const valueOf = (cell) => cell.dataset.value ?? cell.textContent;
  // a spreadsheet would take such a text for a formula
  const harmless = (text) => (/^[=+\-@\t\r]/.test(text) ? `'${text}` : text);
  const fieldOf = (cell) => (cell.classList.contains("num") ? valueOf(cell) : harmless(valueOf(cell)));

  const rowsOf = (number) => (number === 1 ? "1 row" : `${number} rows`);

  function compare(column, numeric, sign) {
    return (one, other) => {
      const a = valueOf(one.cells[column]), b = valueOf(other.cells[column]);
      if (a === "" || b === "") return (a === "") - (b === ""); // what is not known comes last, whichever way
      return sign * (numeric ? Number(a) - Number(b) : order.compare(a, b));
    };
  }

  function copy(text) {
    const byCommand = () => {
      const area = document.createElement("textarea");
      area.value = text;
      document.body.append(area);
      area.select();
      const done = document.execCommand("copy");
      area.remove();
      return done ? Promise.resolve() : Promise.reject(new Error("refused"));
    };
    return navigator.clipboard ? navigator.clipboard.writeText(text).catch(byCommand) : byCommand();
  }

  function download(text, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob(["\ufeff", text], { type: "text/csv" }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }

  function enliven(box) {
    const table = box.querySelector("table");
    if (!table) return;
    const body = table.tBodies[0], heads = [...table.tHead.rows[0].cells], more = box.querySelector("template");
    const all = [...body.rows, ...(more ? more.content.querySelectorAll("tr") : [])];
    const tools = box.querySelector(".tools"), said = tools.querySelector("output");
    const filter = tools.querySelector("input");
    const shown = body.rows.length;
    let rows = all;

    const say = (text) => { said.textContent = text; };
    const lines = (field, separator) => [heads.map((head) => head.textContent).map(field).join(separator),
      ...matching().map((row) => [...row.cells].map(fieldOf).map(field).join(separator))];
    const matching = () => {
      const wanted = filter ? filter.value.trim().toLowerCase() : "";
      const holds = (cell) => `${cell.textContent}\n${valueOf(cell)}`.toLowerCase().includes(wanted);
      return wanted ? rows.filter((row) => [...row.cells].some(holds)) : rows;
    };
    const show = () => {
      const found = matching();
      body.replaceChildren(...found.slice(0, shown));
      say(found.length === all.length ? "" : `${found.length} of ${rowsOf(all.length)}`);
    };

    heads.forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      head.setAttribute("aria-sort", "none");
      button.addEventListener("click", () => {
        const way = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
        heads.forEach((other) => other.setAttribute("aria-sort", "none"));
        head.setAttribute("aria-sort", way);
        rows = [...all].sort(compare(column, head.classList.contains("num"), way === "ascending" ? 1 : -1));
        show();
      });
    });
    filter?.addEventListener("input", show);
    tools.querySelector(".copy").addEventListener("click", () => {
      const plain = (text) => text.replace(/[\t\r\n]+/g, " ");
      const text = lines(plain, "\t");
      copy(text.join("\n")).then(
        () => say(`${rowsOf(text.length - 1)} copied`),
        () => say("This browser does not let the page copy"),
      );
    });
    tools.querySelector(".csv").addEventListener("click", () => {
      const quoted = (text) => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
      download(`${lines(quoted, ",").join("\r\n")}\r\n`, box.dataset.file);
    });
    tools.hidden = false;
  }

  function step(figure) {
    const titles = [...figure.querySelectorAll(":is(h3, h4) .stage")], stages = [...figure.querySelectorAll(".stages .stage")];
    const tools = figure.querySelector(".tools"), slider = tools.querySelector("input"), said = tools.querySelector("output");
    const show = () => {
      for (const parts of [titles, stages]) parts.forEach((part, place) => { part.hidden = place !== slider.valueAsNumber; });
      const number = stages[slider.valueAsNumber].dataset.number;
      said.textContent = slider.ariaValueText = `${number} of ${stages.at(-1).dataset.number}`;
      reachable();
    };
    slider.addEventListener("input", show);
    tools.hidden = false;
    slider.value = stages.length - 1; // a browser may remember another place
    show();
  }

  // what scrolls within its own box can be reached by the keyboard
  function reachable() {
    for (const box of document.querySelectorAll(".scroll")) {
      if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
      else box.removeAttribute("tabindex");
    }
  }

  document.querySelectorAll(".table").forEach(enliven);
  document.querySelectorAll("figure:has(.stages)").forEach(step);
  new ResizeObserver(reachable).observe(document.body);
  document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", reachable));
})();
