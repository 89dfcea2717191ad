// The page's side of splatvol.notebook.Viewer. It asks for one picture at a time: motion that happens meanwhile is
// added up, and goes with the next request.
const restMilliseconds = 200;

function noMotion() {
  return { turn: [0, 0], drag: [0, 0], zoom: 1, reset: false };
}

class Requests {
  constructor(model) {
    this.model = model;
    this.motion = noMotion();
    this.hasMoved = false;
    this.isWaiting = false;
    this.timer = null;
  }

  move(change) {
    change(this.motion);
    this.hasMoved = true;
    this.send();
  }

  // Sends the motion so far, unless an answer is still to come.
  send() {
    if (this.isWaiting || !this.hasMoved) return;
    this.ask({ kind: "move", ...this.motion });
    this.motion = noMotion();
    this.hasMoved = false;
  }

  ask(message) {
    clearTimeout(this.timer);
    this.isWaiting = true;
    this.model.send(message);
  }

  // A picture has come. Asks for a better one: at once if the file is still loading, else after a rest of the mouse.
  answered(isSettled, wasMoving) {
    this.isWaiting = false;
    this.send();
    if (this.isWaiting || isSettled) return;
    this.timer = setTimeout(() => this.ask({ kind: "rest" }), wasMoving ? restMilliseconds : 0);
  }

  stop() {
    clearTimeout(this.timer);
  }
}

function listenToMouse(image, requests) {
  let button = null;
  image.addEventListener("pointerdown", (event) => {
    button = event.button === 2 || event.shiftKey ? "drag" : "turn";
    image.setPointerCapture(event.pointerId);
    event.preventDefault();
  });
  image.addEventListener("pointermove", (event) => {
    if (button === null) return;
    const kind = button;
    requests.move((motion) => {
      motion[kind][0] += event.movementX / image.clientHeight;
      motion[kind][1] += event.movementY / image.clientHeight;
    });
  });
  for (const end of ["pointerup", "pointercancel"]) image.addEventListener(end, () => (button = null));
  image.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      requests.move((motion) => (motion.zoom *= Math.exp(Math.sign(event.deltaY) * 0.1)));
    },
    { passive: false },
  );
  image.addEventListener("dblclick", () =>
    requests.move((motion) => Object.assign(motion, noMotion(), { reset: true })),
  );
  // Neither the browser's menu nor that of JupyterLab, which listens further out.
  image.addEventListener("contextmenu", (event) => {
    event.preventDefault();
    event.stopPropagation();
  });
}

function render({ model, el }) {
  const [width, height] = model.get("size");
  const image = document.createElement("img");
  image.width = width;
  image.height = height;
  image.draggable = false;
  image.style.cssText = "max-width: 100%; touch-action: none; cursor: grab; background: black";
  image.alt = "The volume is being drawn";
  const note = document.createElement("div");
  el.append(image, note);

  const requests = new Requests(model);
  let address = null;
  const onMessage = (message, buffers) => {
    if (message.kind === "error") {
      note.textContent = message.text;
      requests.answered(true, false);
      return;
    }
    note.textContent = "";
    if (address !== null) URL.revokeObjectURL(address);
    address = URL.createObjectURL(new Blob([buffers[0]], { type: message.type }));
    image.src = address;
    requests.answered(message.settled, message.moving);
  };
  model.on("msg:custom", onMessage);
  listenToMouse(image, requests);
  requests.ask({ kind: "rest" });
  return () => {
    requests.stop();
    model.off("msg:custom", onMessage);
    if (address !== null) URL.revokeObjectURL(address);
  };
}

export { Requests, noMotion };
export default { render };
