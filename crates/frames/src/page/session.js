// When to record: a frame is one time stamp of requestAnimationFrame. Everything from there to the next belongs to it.

const IDLE = 0;
const ARMED = 1;
const RECORDING = 2;

/** A page that draws on demand gets a nudge after so long, and is given up later. */
const NUDGE_MS = 1500;
const GIVE_UP_MS = 30_000;
/** While frames are recorded, frame.json is written at least so often: what was recorded until then is whole. */
const PROGRESS_MS = 2000;

let phase = IDLE;
let session = null;
let lastTime = -1;

/** What records: `canvases()` drawn since it was last asked, `begin`, `drawn`, `endFrame`, `end`. */
const sources = [];

/** Replaces a method by `make(original)`. */
function wrap(type, name, make) {
    const original = type?.prototype[name];
    if (!original) return;
    const wrapper = make(original);
    Object.defineProperty(wrapper, 'name', { value: name });
    type.prototype[name] = wrapper;
}

const realRequest = globalThis.requestAnimationFrame;
const realCancel = globalThis.cancelAnimationFrame;

/**
 * Where nothing is shown, as in a headless browser, no display slows a page down: it would queue more and more work
 * for a slow GPU, and reading back would wait for all of it. So its next frame waits until the queue is empty.
 */
let paces = false;
let unfinished = null;
let blocked = false;
let gateTime = -1;
/** Callbacks that wait, by the page's handle. */
const held = new Map();

/** The page submitted work to this queue. */
function submittedTo(queue) {
    unfinished = queue;
}

function mayRun(time) {
    if (time !== gateTime) {
        gateTime = time;
        if (unfinished && (paces || session)) {
            const queue = unfinished;
            unfinished = null;
            blocked = true;
            gpu.onSubmittedWorkDone.call(queue).finally(unblock);
        }
    }
    return !blocked && !session?.done;
}

function unblock() {
    blocked = false;
    if (session?.done) return;
    const waiting = [...held];
    held.clear();
    for (const [handle, callback] of waiting) requestAs(handle, callback);
}

/** Runs a callback in the next frame that may run; the page knows it by `handle`, or by its own new one. */
function requestAs(handle, callback) {
    let name = handle;
    const own = realRequest.call(globalThis, (time) => {
        renamed.delete(name);
        if (phase !== IDLE) boundary(time);
        if (mayRun(time)) callback(time);
        else held.set(name, callback);
    });
    name ??= own;
    if (name !== own) renamed.set(name, own);
    return name;
}

const renamed = new Map();

/** Canvases that the page gave to workers, where the recorder is not. */
let workerCanvases = 0;

function installFrames() {
    paces = typeof globalThis.preshadeSink === 'function';
    globalThis.requestAnimationFrame = function requestAnimationFrame(callback) {
        if (typeof callback !== 'function') return realRequest.apply(this, arguments);
        return requestAs(null, callback);
    };
    wrap(
        globalThis.HTMLCanvasElement,
        'transferControlToOffscreen',
        (original) =>
            function () {
                workerCanvases += 1;
                return original.call(this);
            },
    );
    globalThis.cancelAnimationFrame = function cancelAnimationFrame(handle) {
        held.delete(handle);
        realCancel.call(globalThis, renamed.get(handle) ?? handle);
    };
}

/** Waits for the time of the next frame even where the page asks for none. */
function tick() {
    realRequest.call(globalThis, (time) => {
        if (phase === IDLE) return;
        boundary(time);
        if (phase !== IDLE && !blocked) drawOnDemand();
        tick();
    });
}

/** For a page that draws on demand, its own way to draw. */
function drawOnDemand() {
    try {
        session?.draw?.();
    } catch (error) {
        fail(error);
    }
}

function boundary(time) {
    if (time === lastTime) return;
    lastTime = time;
    try {
        if (phase === ARMED) arm(time);
        else if (session.origin.drawn()) closeFrame(time);
        if (phase !== IDLE) idleTime();
    } catch (error) {
        fail(error);
    }
}

/** Chooses the largest canvas of those drawn in the last frame, and begins. */
function arm(time) {
    let best = null;
    for (const source of sources) {
        for (const canvas of source.canvases()) {
            canvas.source = source;
            if (!best || canvas.area > best.area) best = canvas;
        }
    }
    if (!best) return;
    session.origin = best.source;
    session.first = time;
    session.time = time;
    session.last = performance.now();
    session.nudges = 0;
    session.folder = new Folder(session.sink, best.source.describe(best));
    best.source.begin(session.folder, best);
    phase = RECORDING;
}

function closeFrame(time) {
    const frame = session.origin.endFrame();
    frame.time = (session.time - session.first) / 1000;
    session.time = time;
    session.last = performance.now();
    session.nudges = 0;
    session.recorded += 1;
    const isLast = session.recorded === session.wanted;
    if (isLast) {
        phase = IDLE;
        session.done = true;
        session.origin.end();
    }
    session.writing = session.writing.then(() => writeFrame(frame, isLast)).catch(fail);
}

async function writeFrame({ time, write }, isLast) {
    const { folder } = session;
    const frame = await write();
    folder.frames.push({ time, ...frame });
    if (!isLast && performance.now() - session.written < PROGRESS_MS) return;
    session.written = performance.now();
    folder.write();
    if (!isLast) return;
    await folder.tar.close();
    const { resolve } = session;
    session.origin.release();
    session = null;
    unblock();
    resolve(summary(folder));
}

function summary(folder) {
    return {
        frames: folder.frames.length,
        bytes: folder.tar.bytes,
        refused: [...folder.refusals.values()],
        unknown: folder.unknown,
    };
}

function idleTime() {
    const waited = performance.now() - session.last;
    if (waited > NUDGE_MS * (session.nudges + 1)) {
        session.nudges += 1;
        globalThis.dispatchEvent(new Event('resize'));
    }
    if (waited > session.patience) {
        const why = workerCanvases ? ': a canvas of it is drawn by a worker, which is not recorded' : '';
        const remedy =
            '; if it loads longer, give --patience or --wait-for; if it draws on demand, give --draw (or `draw` of ' +
            'start) the JavaScript that draws';
        fail(new Error(`the page drew nothing in ${session.patience / 1000} s by WebGL or WebGPU${why || remedy}`));
    }
}

/** Ends a capture. The frames that were written stay. */
function fail(error) {
    phase = IDLE;
    const failed = session;
    session = null;
    if (!failed) return;
    unblock();
    failed.origin?.end();
    failed.origin?.release();
    failed.sink.close();
    failed.reject(error);
}

/**
 * Records `frames` frames, from the next that the page draws. Resolves to a summary once all is written. `draw` is called
 * in every frame until then. A page that draws nothing in `patience` milliseconds is given up.
 */
function startCapture({ frames = 1, draw, patience = GIVE_UP_MS, sink } = {}) {
    if (session) return Promise.reject(new Error('a capture is under way'));
    return new Promise((resolve, reject) => {
        session = {
            wanted: Math.max(1, frames | 0),
            recorded: 0,
            nudges: 0,
            draw,
            patience,
            sink: sink ?? defaultSink(),
            writing: Promise.resolve(),
            last: performance.now(),
            written: performance.now(),
            resolve,
            reject,
        };
        for (const source of sources) source.canvases();
        phase = ARMED;
        tick();
    });
}

function defaultSink() {
    const send = globalThis.preshadeSink;
    return typeof send === 'function' ? new BindingSink(send) : new DownloadSink('frame.tar');
}
