// Puts the recorder into the page, once.

if (!globalThis.preshadeCapture) {
    installFrames();
    installWebgpu();
    installWebgl();
    Object.defineProperty(globalThis, 'preshadeCapture', { value: { start: startCapture } });
}
