// A frame folder as a tar stream, and where the stream goes.

const TAR_BLOCK = 512;

/** The header of a file of `size` bytes, in the ustar format. */
function tarHeader(name, size) {
    const header = new Uint8Array(TAR_BLOCK);
    const text = (offset, value) => {
        for (let i = 0; i < value.length; i++) header[offset + i] = value.charCodeAt(i);
    };
    const octal = (offset, digits, value) => text(offset, value.toString(8).padStart(digits, '0'));
    text(0, name);
    octal(100, 7, 0o644);
    octal(108, 7, 0);
    octal(116, 7, 0);
    // Eleven digits hold 8 GiB.
    octal(124, 11, size);
    octal(136, 11, 0);
    text(148, '        ');
    text(156, '0');
    text(257, 'ustar');
    text(263, '00');
    octal(
        148,
        6,
        header.reduce((sum, byte) => sum + byte, 0),
    );
    header[154] = 0;
    return header;
}

/** Writes files into a sink: `write(bytes)`, `flush()` that may be awaited, `close()`. */
class Tar {
    constructor(sink) {
        this.sink = sink;
        this.bytes = 0;
    }

    file(name, bytes) {
        this.sink.write(tarHeader(name, bytes.length));
        this.sink.write(bytes);
        const rest = bytes.length % TAR_BLOCK;
        if (rest) this.sink.write(new Uint8Array(TAR_BLOCK - rest));
        this.bytes += bytes.length;
    }

    async close() {
        this.sink.write(new Uint8Array(2 * TAR_BLOCK));
        await this.sink.close();
    }
}

// Three divides it, so that a chunk's base64 needs no padding.
const CHUNK = 3 << 18;

function base64(bytes) {
    if (bytes.toBase64) return bytes.toBase64();
    let binary = '';
    for (let at = 0; at < bytes.length; at += 0x8000) {
        binary += String.fromCharCode.apply(null, bytes.subarray(at, at + 0x8000));
    }
    return btoa(binary);
}

/** Sends base64 chunks through a function that DevTools' protocol added to the page, and an empty one as the end. */
class BindingSink {
    constructor(send) {
        this.send = send;
        this.chunk = new Uint8Array(CHUNK);
        this.used = 0;
    }

    write(bytes) {
        for (let at = 0; at < bytes.length;) {
            const count = Math.min(bytes.length - at, CHUNK - this.used);
            this.chunk.set(bytes.subarray(at, at + count), this.used);
            this.used += count;
            at += count;
            if (this.used === CHUNK) this.push();
        }
    }

    push() {
        if (!this.used) return;
        this.send(base64(this.chunk.subarray(0, this.used)));
        this.used = 0;
    }

    close() {
        this.push();
        this.send('');
    }
}

/** Collects the stream and offers it as a download. */
class DownloadSink {
    constructor(name) {
        this.name = name;
        this.parts = [];
    }

    write(bytes) {
        this.parts.push(bytes.slice());
    }

    close() {
        const link = document.createElement('a');
        link.href = URL.createObjectURL(new Blob(this.parts, { type: 'application/x-tar' }));
        link.download = this.name;
        link.click();
        this.parts = [];
        setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
    }
}
