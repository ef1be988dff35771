"""Use of the page without a mouse: what each key does, and names and states for screen readers."""

from __future__ import annotations

#: Effect of a key on the window: shifts as fractions of its width and height, and scale factor.
MOVES = {
    "ArrowLeft": (-0.1, 0.0, 1.0),
    "ArrowRight": (0.1, 0.0, 1.0),
    "ArrowDown": (0.0, -0.1, 1.0),
    "ArrowUp": (0.0, 0.1, 1.0),
    "+": (0.0, 0.0, 0.5),
    "-": (0.0, 0.0, 2.0),
}
#: Sends every key that the widget with the focus does not use to a text field; a counter makes each
#: value different from the last. Enter shows a motion only on a plot, and opens a tab, which Bokeh
#: leaves to the mouse.
LISTEN = """
document.getElementById("opening")?.remove();
let number = 0;
window.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const at = event.composedPath()[0], key = event.key;
  if (at.matches?.(".bk-tab") && ["Enter", " "].includes(key)) {
    event.preventDefault();
    at.click();
  }
  if (key !== "Escape" && at.closest?.("input, select, .noUi-handle")) return;
  if (KEYS.includes(key) || (key === "Enter" && at.matches?.(".bk-events"))) {
    event.preventDefault();
    to.value = `${++number} ${key}`;
  }
});
""".replace("KEYS", str([*MOVES, "Home", "Escape"]))
#: Bokeh gives a label or a title to the outermost element of a model only; this hands it on to the
#: element that has the focus. It also puts the tabs before their contents, as the Tab key comes to
#: them, and tells which tab is open, and which buttons are pressed.
DESCRIBE = """
const tell = (element, state) => {
  const set = () => element.setAttribute(state, element.classList.contains("bk-active"));
  new MutationObserver(set).observe(element, {attributeFilter: ["class"]});
  set();
};
const visit = (root, name) => {
  for (const element of root.querySelectorAll("*")) {
    if (element.matches(".bk-events")) element.setAttribute("role", "application");
    if (element.matches(".bk-events, .noUi-handle, input") && name) element.ariaLabel = name;
    if (element.matches(".bk-OnOffButton, .bk-ClickButton")) element.setAttribute("role", "button");
    if (element.matches(".bk-header")) root.prepend(element);
    if (element.matches(".bk-headers-wrapper")) element.setAttribute("role", "tablist");
    if (element.matches(".bk-tab")) {
      element.setAttribute("role", "tab");
      tell(element, "aria-selected");
    }
    if (element.matches(".bk-btn") && !root.host.matches(".bk-Button")) {
      tell(element, "aria-pressed");
    }
    if (element.shadowRoot) visit(element.shadowRoot, element.ariaLabel || element.title || name);
  }
};
visit(document, "");
"""


def labelled(text: str) -> dict[str, str]:
    """Return the attributes of a model for a screen reader: a group with a label."""
    return {"role": "group", "aria-label": text}
