// How long frames take: what the GPU takes by EXT_disjoint_timer_query_webgl2, or else by a fence that is looked at between tasks; and what the page's thread takes, if that is more.

/** The name of the device, as far as the browser tells it. */
export function adapter(gl) {
    const info = gl.getExtension('WEBGL_debug_renderer_info');
    return String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}

/** Rasterisers in software whose timer queries end before the drawing does: it is put off. */
const DEFERS = /llvmpipe|softpipe/i;

export class Timer {
    #renderer;
    #wanted;
    #open = null;
    /** Frames whose GPU time is not known yet, in order. */
    #pending = [];
    #extension;
    /** When the last fence had been reached: a frame starts no earlier on the GPU. */
    #reached = 0;
    #channel = null;

    /** `method`: `timer-query` or `fence`; by default the first where the driver has it. */
    constructor(renderer, method = null) {
        this.#renderer = renderer;
        this.#wanted = method;
        this.restart();
    }

    /** `timer-query` or `fence`. */
    get method() {
        return this.#extension ? 'timer-query' : 'fence';
    }

    /** After a lost context: its queries are gone. */
    restart() {
        const gl = this.#renderer.getContext();
        const extension = gl.getExtension('EXT_disjoint_timer_query_webgl2');
        const has = extension && gl.getQuery(extension.TIME_ELAPSED_EXT, extension.QUERY_COUNTER_BITS_EXT) > 0;
        const method = this.#wanted ?? (DEFERS.test(adapter(gl)) ? 'fence' : 'timer-query');
        this.#extension = has && method === 'timer-query' ? extension : null;
        this.#open = null;
        for (const { done } of this.#pending.splice(0)) done(null);
    }

    /** From here on; `done` is called in a later frame or task, with milliseconds, or null where they are not known. `since`: when the page's thread began. */
    begin(done, since = performance.now()) {
        const gl = this.#renderer.getContext();
        const of = { done, since, query: null, fence: null, cpu: 0 };
        if (this.#extension) {
            // Somebody else measures: there can be only one.
            if (gl.getQuery(this.#extension.TIME_ELAPSED_EXT, gl.CURRENT_QUERY) !== null) return void done(null);
            of.query = gl.createQuery();
            gl.beginQuery(this.#extension.TIME_ELAPSED_EXT, of.query);
        }
        this.#open = of;
    }

    end() {
        const of = this.#open;
        if (!of) return;
        this.#open = null;
        const gl = this.#renderer.getContext();
        of.cpu = performance.now() - of.since;
        if (of.query) gl.endQuery(this.#extension.TIME_ELAPSED_EXT);
        else {
            of.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
            gl.flush();
            this.#watch();
        }
        this.#pending.push(of);
    }

    /** Calls those back whose time is known by now. */
    poll() {
        const gl = this.#renderer.getContext();
        // What the disjoint operation fell into is not told.
        const lost = this.#extension && this.#pending.length > 0 && gl.getParameter(this.#extension.GPU_DISJOINT_EXT);
        if (lost) {
            for (const { query, done } of this.#pending.splice(0)) {
                gl.deleteQuery(query);
                done(null);
            }
        }
        while (this.#pending.length > 0) {
            const [of] = this.#pending;
            const gpu = of.query ? this.#byQuery(gl, of) : this.#byFence(gl, of);
            if (gpu === null) return;
            this.#pending.shift();
            of.done(Math.max(gpu, of.cpu));
        }
    }

    #byQuery(gl, { query }) {
        if (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE)) return null;
        const nanoseconds = gl.getQueryParameter(query, gl.QUERY_RESULT);
        gl.deleteQuery(query);
        return nanoseconds / 1e6;
    }

    #byFence(gl, { fence, since }) {
        if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return null;
        gl.deleteSync(fence);
        const now = performance.now();
        const from = Math.max(since, this.#reached);
        this.#reached = now;
        return now - from;
    }

    /** Looks at fences between tasks: messages are not delayed as timers are. */
    #watch() {
        if (this.#channel) return;
        this.#channel = new MessageChannel();
        const { port1, port2 } = this.#channel;
        port1.onmessage = () => {
            if (!this.#channel) return;
            this.poll();
            if (this.#pending.length > 0) port2.postMessage(0);
            else this.#stop();
        };
        port2.postMessage(0);
    }

    #stop() {
        this.#channel?.port1.close();
        this.#channel = null;
    }

    dispose() {
        const gl = this.#renderer.getContext();
        this.#stop();
        for (const { query, fence } of this.#pending.splice(0)) {
            if (query) gl.deleteQuery(query);
            if (fence) gl.deleteSync(fence);
        }
    }
}
