// The page of a run under way: loads itself again, where the reader left it, until it is paused or the run has ended.

const PATIENCE = 12; // missed renewals before the page says that nothing comes

const pause = document.getElementById("pause") as HTMLButtonElement;
const silent = document.getElementById("silent") as HTMLElement;
const { updatedS, reloadS, goOn, silent: said } = pause.dataset as Record<string, string>;
const label = pause.textContent ?? "";
let timer = 0;

function start(): void {
  pause.textContent = label;
  timer = window.setTimeout(() => location.reload(), 1000 * Number(reloadS));
}

pause.hidden = false;
pause.addEventListener("click", () => {
  if (!timer) return start();
  clearTimeout(timer);
  timer = 0;
  pause.textContent = goOn;
});
const silent_s = Date.now() / 1000 - Number(updatedS);
if (silent_s > PATIENCE * Number(reloadS)) silent.textContent = said.replace("{minutes}", String(Math.round(silent_s / 60)));
start();
