// MurmurHash3 (x86, 128 bits, seed 0): names of data files. Fast without `crypto`, which insecure pages lack.

function rotate(value, bits) {
    return (value << bits) | (value >>> (32 - bits));
}

function finish(h) {
    h = Math.imul(h ^ (h >>> 16), 0x85ebca6b);
    h = Math.imul(h ^ (h >>> 13), 0xc2b2ae35);
    return h ^ (h >>> 16);
}

const C1 = 0x239b961b;
const C2 = 0xab0e9789 | 0;
const C3 = 0x38b34ae5;
const C4 = 0xa1e38b93 | 0;

/** The hash of a Uint8Array as 32 hexadecimal digits. */
function hash(bytes) {
    const length = bytes.length;
    const blocks = length >>> 4;
    const aligned = bytes.byteOffset % 4 === 0 ? bytes : bytes.slice();
    const words = new Int32Array(aligned.buffer, aligned.byteOffset, blocks * 4);
    let h1 = 0;
    let h2 = 0;
    let h3 = 0;
    let h4 = 0;
    for (let i = 0; i < blocks * 4; i += 4) {
        h1 ^= Math.imul(rotate(Math.imul(words[i], C1), 15), C2);
        h1 = (Math.imul((rotate(h1, 19) + h2) | 0, 5) + 0x561ccd1b) | 0;
        h2 ^= Math.imul(rotate(Math.imul(words[i + 1], C2), 16), C3);
        h2 = (Math.imul((rotate(h2, 17) + h3) | 0, 5) + 0x0bcaa747) | 0;
        h3 ^= Math.imul(rotate(Math.imul(words[i + 2], C3), 17), C4);
        h3 = (Math.imul((rotate(h3, 15) + h4) | 0, 5) + 0x96cd1c35) | 0;
        h4 ^= Math.imul(rotate(Math.imul(words[i + 3], C4), 18), C1);
        h4 = (Math.imul((rotate(h4, 13) + h1) | 0, 5) + 0x32ac3b17) | 0;
    }
    const tail = new Int32Array(4);
    const tailBytes = new Uint8Array(tail.buffer);
    tailBytes.set(aligned.subarray(blocks * 16));
    h4 ^= Math.imul(rotate(Math.imul(tail[3], C4), 18), C1);
    h3 ^= Math.imul(rotate(Math.imul(tail[2], C3), 17), C4);
    h2 ^= Math.imul(rotate(Math.imul(tail[1], C2), 16), C3);
    h1 ^= Math.imul(rotate(Math.imul(tail[0], C1), 15), C2);
    h1 ^= length;
    h2 ^= length;
    h3 ^= length;
    h4 ^= length;
    h1 = (h1 + h2 + h3 + h4) | 0;
    h2 = (h2 + h1) | 0;
    h3 = (h3 + h1) | 0;
    h4 = (h4 + h1) | 0;
    h1 = finish(h1);
    h2 = finish(h2);
    h3 = finish(h3);
    h4 = finish(h4);
    h1 = (h1 + h2 + h3 + h4) | 0;
    h2 = (h2 + h1) | 0;
    h3 = (h3 + h1) | 0;
    h4 = (h4 + h1) | 0;
    return [h1, h2, h3, h4].map((h) => (h >>> 0).toString(16).padStart(8, '0')).join('');
}
