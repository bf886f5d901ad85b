// Put before a page: random numbers with a seed, and a clock that counts frames. Time stands still from when the page
// is ready until it is recorded, so every run records the same pictures. A page that loads for an unknown number of
// frames names the number after which its time stands still until it is loaded: `surveyLoading`.

(() => {
    const STEP = 1000 / 60;
    /** Frames that a page draws after it has loaded, before it is ready. */
    const SETTLING = globalThis.surveyLoading ? 4 : 12;
    const LOADING = globalThis.surveyLoading ?? 0;

    let state = 0x2545f491;
    Math.random = () => {
        state = (state + 0x6d2b79f5) | 0;
        let t = Math.imul(state ^ (state >>> 15), 1 | state);
        t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
        return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
    };

    let now = 0;
    let settled = 0;
    let loading = 0;
    let moves = true;
    let last = -1;
    performance.now = () => now;
    const epoch = Date.UTC(2026, 0, 1);
    Date.now = () => epoch + Math.floor(now);
    globalThis.Date = new Proxy(Date, {
        construct: (real, words, made) => Reflect.construct(real, words.length ? words : [real.now()], made),
    });

    const request = globalThis.requestAnimationFrame;
    globalThis.requestAnimationFrame = (callback) =>
        request((time) => {
            if (time !== last) {
                last = time;
                const waits = LOADING && loading === LOADING && !globalThis.loaded;
                if (moves && !waits) now += STEP;
                if (loading < LOADING) loading++;
                else if (globalThis.loaded && !globalThis.ready && ++settled > SETTLING) {
                    moves = false;
                    globalThis.ready = true;
                }
            }
            callback(now);
        });
    const capture = globalThis.preshadeCapture;
    if (capture) {
        const { start } = capture;
        capture.start = (options) => {
            moves = true;
            return start(options);
        };
    }
    // Pages that draw on demand ask for no frames.
    const tick = () => requestAnimationFrame(tick);
    tick();
})();
