// Dark or light: that of the system, or the reader's choice, which the browser remembers where it can.

const stored = {
  get: () => { try { return localStorage.getItem("theme"); } catch { return null; } },
  set: (value) => { try { localStorage.setItem("theme", value); } catch { /* files may have no storage */ } },
};

/** Let a button switch the theme; `changed` is called after each change. */
export function themed(button, changed) {
  const root = document.documentElement, system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = stored.get();
  const show = () => {
    root.dataset.theme = chosen ?? (system.matches ? "dark" : "light");
    const other = root.dataset.theme === "dark" ? "light" : "dark";
    button.textContent = other === "dark" ? "Dark" : "Light";
    button.setAttribute("aria-label", `switch to the ${other} theme`);
    changed();
  };
  button.addEventListener("click", () => {
    chosen = root.dataset.theme === "dark" ? "light" : "dark";
    stored.set(chosen);
    show();
  });
  system.addEventListener("change", show);
  show();
}
