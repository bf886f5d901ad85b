// Values by name in IndexedDB. Where there is none (private windows, node), nothing is kept and nothing fails.

/** So many are kept, of all makers together; the oldest go. */
const LIMIT = 2000;

export class Store {
    #opened;
    #maker;

    /** A database `name`. Each `maker` finds only what it kept itself. */
    constructor(name, maker) {
        this.#maker = maker;
        this.#opened = opened(name).catch(() => null);
    }

    async get(key) {
        return this.#do('readonly', (values) => values.get([this.#maker, key])).then((row) => row?.value);
    }

    async set(key, value) {
        await this.#do('readwrite', (values) =>
            values.put({ value: { ...value }, at: Date.now() }, [this.#maker, key]),
        );
        const count = await this.#do('readonly', (values) => values.count());
        if (count > LIMIT) await this.#do('readwrite', (values) => oldest(values.index('at'), count - LIMIT));
    }

    async close() {
        (await this.#opened)?.close();
        this.#opened = Promise.resolve(null);
    }

    async #do(mode, act) {
        try {
            const database = await this.#opened;
            if (!database) return undefined;
            return await answered(act(database.transaction('values', mode).objectStore('values')));
        } catch {
            return undefined;
        }
    }
}

const answered = (request) =>
    new Promise((resolve, reject) => {
        request.onsuccess = () => resolve(request.result);
        request.onerror = () => reject(request.error);
    });

/** Deletes the first `count` rows. */
function oldest(index, count) {
    const request = index.openCursor();
    request.onsuccess = () => {
        const cursor = request.result;
        if (!cursor || count-- <= 0) return;
        cursor.delete();
        cursor.continue();
    };
    return request;
}

async function opened(name) {
    const request = indexedDB.open(name, 1);
    request.onupgradeneeded = () => request.result.createObjectStore('values').createIndex('at', 'at');
    const database = await answered(request);
    // Another page wants to delete it.
    database.onversionchange = () => database.close();
    return database;
}
