// Light or dark as the reader's system is, at once: colours do not fade over when a page opens.
const dark = matchMedia("(prefers-color-scheme: dark)");
const follow = () => {
  document.body.setAttribute("data-md-color-switching", "");
  document.body.setAttribute("data-md-color-scheme", dark.matches ? "slate" : "default");
  void document.body.offsetWidth;
  document.body.removeAttribute("data-md-color-switching");
};
dark.addEventListener("change", follow);
follow();
