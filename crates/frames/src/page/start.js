// Puts the recorder into the page, once. A script tag may say when to begin: data-after seconds, data-frames frames.

if (!globalThis.preshadeCapture) {
    installFrames();
    installWebgpu();
    installWebgl();
    Object.defineProperty(globalThis, 'preshadeCapture', {
        value: { start: startCapture, errors: () => [...pageErrors] },
    });
    const { after, frames } = document.currentScript?.dataset ?? {};
    if (after !== undefined) {
        const begin = () => startCapture({ frames: Number(frames ?? 1) }).then(console.log, console.error);
        setTimeout(begin, Number(after) * 1000);
    }
}
