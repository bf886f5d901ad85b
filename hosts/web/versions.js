// Which specialised version a draw takes: the choice of `MATERIAL.versions.json`, remembered by the words that decide it.

/** Most choices to remember. A word that changes all the time would fill the memory. */
const MOST = 4096;

/**
 * A function that chooses the version of a draw: see versions.d.ts.
 */
export function dispatch({ versions }) {
    const all = versions.flatMap(({ guard }) => guard.values);
    const isUniform = ({ place }) => place.from === 'uniform';
    const where = ({ place: { group, binding, offset } }) => `${group} ${binding} ${offset}`;
    const words = [...new Map(all.filter(isUniform).map((value) => [where(value), value.place])).values()];
    const fixed = [...new Map(all.filter((v) => !isUniform(v)).map((v) => [JSON.stringify(v), v])).values()];
    const chosen = new Map();
    return (bytes, isKept = () => false) => {
        const view = (group, binding) => {
            const data = bytes(group, binding);
            if (!data) return undefined;
            return ArrayBuffer.isView(data)
                ? new DataView(data.buffer, data.byteOffset, data.byteLength)
                : new DataView(data);
        };
        const read = ({ group, binding, offset }, type = 'u32') => {
            const data = view(group, binding);
            return data && offset + 4 <= data.byteLength ? data[READ[type]](offset, true) : undefined;
        };
        const kept = new Map(fixed.map((value) => [JSON.stringify(value), Boolean(isKept(value))]));
        const key = [...words.map((place) => read(place)), ...kept.values()].join();
        if (!chosen.has(key)) {
            if (chosen.size >= MOST) chosen.clear();
            const holds = (value) => {
                if (!isUniform(value)) return kept.get(JSON.stringify(value));
                const number = read(value.place, value.type);
                return value.low <= number && number <= value.high;
            };
            chosen.set(
                key,
                versions.find(({ guard }) => guard.values.every(holds)),
            );
        }
        return chosen.get(key);
    };
}

const READ = { f32: 'getFloat32', i32: 'getInt32', u32: 'getUint32' };
