// What the page holds, in the fragment of its address: JSON, compressed, in base64 for addresses.

/** A link holds no more than this once it is unpacked. A short one could hold gigabytes. */
const MOST = 8 << 20;

const toBase64 = (bytes) => {
    let text = '';
    for (let at = 0; at < bytes.length; at += 0x8000) text += String.fromCharCode(...bytes.subarray(at, at + 0x8000));
    return btoa(text).replaceAll('+', '-').replaceAll('/', '_').replace(/=+$/, '');
};
const fromBase64 = (text) =>
    Uint8Array.from(atob(text.replaceAll('-', '+').replaceAll('_', '/')), (c) => c.charCodeAt(0));

async function through(bytes, transform) {
    const reader = new Blob([bytes]).stream().pipeThrough(transform).getReader();
    const parts = [];
    let length = 0;
    for (;;) {
        const { done, value } = await reader.read();
        if (done) break;
        length += value.length;
        if (length > MOST) {
            await reader.cancel();
            throw new Error('it holds more than 8 MB');
        }
        parts.push(value);
    }
    return new Uint8Array(await new Blob(parts).arrayBuffer());
}

/** The fragment, without `#`. */
export async function pack(held) {
    const bytes = new TextEncoder().encode(JSON.stringify(held));
    if (!globalThis.CompressionStream) return `u=${toBase64(bytes)}`;
    return `s=${toBase64(await through(bytes, new CompressionStream('deflate-raw')))}`;
}

/** What a fragment holds, or `null` where it is none of ours. It throws if it is damaged. */
export async function unpack(fragment) {
    const [, kind, text] = /^#?([su])=([\w-]+)$/.exec(fragment) ?? [];
    if (!kind) return null;
    let bytes = fromBase64(text);
    if (kind === 's') bytes = await through(bytes, new DecompressionStream('deflate-raw'));
    return checked(JSON.parse(new TextDecoder('utf-8', { fatal: true }).decode(bytes)));
}

/** A link may have been written by anyone. */
function checked(held) {
    const isText = (value) => typeof value === 'string';
    const { v, files, recipe, state, define } = held ?? {};
    const isFile = (file) => isText(file?.name) && isText(file?.text);
    const isState = state && typeof state === 'object' && !Array.isArray(state);
    if (v !== 1) throw new Error('it was made by another version of this page');
    if (!Array.isArray(files) || files.length < 1 || files.length > 2 || !files.every(isFile) || !isText(recipe))
        throw new Error('it holds no shader');
    return {
        files: files.map(({ name, text }) => ({ name, text })),
        recipe,
        state: isState ? state : {},
        define: isText(define) ? define : '',
    };
}
