// What one render pass takes on the device, by timestamps; without `timestamp-query`, until the queue is done with it.

const SLOTS = 8;

export class Timer {
    #backend;
    #device;
    #context = null;
    #method = null;
    /** The pass that is recorded now: `{ writes, began, done }`. */
    #pass = null;
    #slots = null;

    constructor(backend) {
        this.#backend = backend;
        this.#device = backend.device;
    }

    /** Whether times are the device's own. */
    get isExact() {
        return this.#method !== 'fence' && this.#device.features.has('timestamp-query');
    }

    /**
     * Passes of this context can be timed from the next one on; `null`: of none. `method`: `fence` asks the queue, though
     * there are timestamps.
     */
    watch(context, method = null) {
        this.#method = method;
        if (context === this.#context) return;
        if (this.#context === null) this.#install();
        this.#context = context;
        if (context === null) this.#remove();
    }

    /** Has the milliseconds of the pass that three.js records now handed to `done`; `null` where they are not known. */
    take(done) {
        if (this.#pass === null) done(null);
        else this.#pass.done = done;
    }

    dispose() {
        this.watch(null);
        for (const { read } of this.#slots?.all ?? []) read.destroy();
        this.#slots?.queries.destroy();
        this.#slots?.resolved.destroy();
        this.#slots = null;
    }

    #install() {
        const timer = this;
        const backend = this.#backend;
        const { beginRender, finishRender, initTimestampQuery } = backend.constructor.prototype;
        let isWatched = false;
        backend.beginRender = function (context) {
            isWatched = context === timer.#context;
            if (isWatched) timer.#pass = { writes: null, began: performance.now(), done: null };
            beginRender.call(this, context);
            isWatched = false;
        };
        backend.initTimestampQuery = function (type, uid, descriptor) {
            initTimestampQuery.call(this, type, uid, descriptor);
            if (isWatched && timer.isExact) timer.#begin(descriptor);
        };
        backend.finishRender = function (context) {
            finishRender.call(this, context);
            if (context === timer.#context) timer.#finish();
        };
    }

    #remove() {
        for (const name of ['beginRender', 'initTimestampQuery', 'finishRender']) delete this.#backend[name];
        this.#pass = null;
    }

    /** Where three.js takes timestamps itself, those are read. */
    #begin(descriptor) {
        this.#slots ??= this.#make();
        const { all, queries } = this.#slots;
        const slot = all.find(({ isBusy }) => !isBusy);
        if (!slot) return;
        descriptor.timestampWrites ??= {
            querySet: queries,
            beginningOfPassWriteIndex: 2 * slot.index,
            endOfPassWriteIndex: 2 * slot.index + 1,
        };
        this.#pass.writes = { ...descriptor.timestampWrites, slot };
    }

    #finish() {
        const { writes, began, done } = this.#pass ?? {};
        this.#pass = null;
        if (!done) return;
        const device = this.#device;
        if (!this.isExact) {
            device.queue.onSubmittedWorkDone().then(
                () => done(performance.now() - began),
                () => done(null),
            );
            return;
        }
        if (!writes) return done(null);
        const { slot, querySet, beginningOfPassWriteIndex: first } = writes;
        const { resolved } = this.#slots;
        const encoder = device.createCommandEncoder({ label: 'preshade timer' });
        encoder.resolveQuerySet(querySet, first, 2, resolved, 256 * slot.index);
        encoder.copyBufferToBuffer(resolved, 256 * slot.index, slot.read, 0, 16);
        device.queue.submit([encoder.finish()]);
        slot.isBusy = true;
        slot.read.mapAsync(GPUMapMode.READ).then(
            () => {
                const [begin, end] = new BigUint64Array(slot.read.getMappedRange());
                const milliseconds = Number(end - begin) / 1e6;
                slot.read.unmap();
                slot.isBusy = false;
                done(milliseconds > 0 ? milliseconds : null);
            },
            () => done(null),
        );
    }

    #make() {
        const device = this.#device;
        const { QUERY_RESOLVE, COPY_SRC, COPY_DST, MAP_READ } = GPUBufferUsage;
        return {
            queries: device.createQuerySet({ label: 'preshade timer', type: 'timestamp', count: 2 * SLOTS }),
            resolved: device.createBuffer({ size: 256 * SLOTS, usage: QUERY_RESOLVE | COPY_SRC }),
            all: Array.from({ length: SLOTS }, (_, index) => ({
                index,
                isBusy: false,
                read: device.createBuffer({ size: 16, usage: MAP_READ | COPY_DST }),
            })),
        };
    }
}
