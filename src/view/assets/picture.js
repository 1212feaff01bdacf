// What the camera sees, as an inset: only where the server has pictures to show.

import { keep } from './connections.js';

/** The newest picture of the camera that is shown. Without `--show-picture` it never asks for one. */
export class Picture {
  constructor(canvas) {
    // `taken` are so far, and `settled` is the last of them that was drawn or hidden.
    Object.assign(this, { canvas, camera: null, sequence: null, taken: 0, settled: 0 });
    this.context = canvas.getContext('2d');
  }

  /** `url` takes a path to an address. */
  connect(url) {
    const make = () => {
      const socket = new WebSocket(url('ws', 'pictures'));
      socket.binaryType = 'arraybuffer';
      socket.onmessage = ({ data }) => this.take(data);
      return socket;
    };
    keep(make, () => this.hide());
  }

  /** `live`: whether the newest frame is shown; of the past there are no pictures. */
  choose(camera, live) {
    if (camera !== this.camera || !live) this.hide();
    this.camera = live ? camera : null;
  }

  hide() {
    this.settled = this.taken;
    this.canvas.hidden = true;
    this.sequence = null;
  }

  async take(buffer) {
    const view = new DataView(buffer);
    if (buffer.byteLength < 36 || view.getUint32(0, false) !== 0x50494354 || view.getUint16(4, true) !== 1) return;
    const nameBytes = view.getUint32(32, true);
    const camera = new TextDecoder().decode(new Uint8Array(buffer, 36, nameBytes));
    const jpeg = new Uint8Array(buffer, 36 + Math.ceil(nameBytes / 4) * 4);
    if (camera !== this.camera) return;
    if (jpeg.length === 0) {
      this.hide();
      return;
    }
    // Nobody looks: of a page in the background the next one is soon enough.
    if (document.hidden) return;
    const number = ++this.taken;
    const picture = await createImageBitmap(new Blob([jpeg], { type: 'image/jpeg' }));
    try {
      // A newer one may have been unpacked sooner.
      if (number <= this.settled) return;
      this.settled = number;
      this.draw(picture);
      this.sequence = Number(view.getBigUint64(8, true));
    } finally {
      // Its memory is the browser's, which frees it late.
      picture.close();
    }
  }

  draw(picture) {
    const { width, height } = picture;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    this.context.drawImage(picture, 0, 0);
    this.canvas.hidden = false;
  }

  /** For whoever drives the page by a program: what is shown, and the mean colour of it. */
  read() {
    if (this.canvas.hidden) return null;
    const { width, height } = this.canvas;
    const pixels = this.context.getImageData(0, 0, width, height).data;
    const sums = [0, 0, 0];
    for (let i = 0; i < pixels.length; i += 4) for (let c = 0; c < 3; c++) sums[c] += pixels[i + c];
    return { width, height, sequence: this.sequence, colour: sums.map((s) => s / (width * height)) };
  }
}
