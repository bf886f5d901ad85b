// Whether a program moves vertices and leaves their normals as they were. It is told by what the two are computed from, which is enough for a hint. Texts are those that preshade writes.

/** What places a vertex or turns a normal in every program of three.js. */
const PLAIN = new RegExp(
    `^(?:${[
        ...['position', 'normal', 'modelMatrix', 'viewMatrix', 'modelViewMatrix', 'projectionMatrix', 'normalMatrix'],
        ...['instanceMatrix\\w*', 'bindMatrix', 'bindMatrixInverse', 'boneTexture', 'skinIndex', 'skinWeight'],
        ...['batchingTexture', 'batchingIdTexture', '_gl_DrawID'],
    ].join('|')})$`,
);
/** Functions of GLSL that bend nothing, and words that are followed by a bracket. */
const STRAIGHT =
    /^(?:[iub]?vec[234]|mat[234](?:x[234])?|float|u?int|bool|normalize|dot|length|inversesqrt|texelFetch|textureSize|if|for|while|switch|return)$/;
const NAME = /(?<![\w.])[a-zA-Z_]\w*/g;

/** A list of arguments, without its brackets. */
function split(list) {
    const found = [''];
    let depth = 0;
    for (const letter of list) {
        if (letter === ',' && depth === 0) found.push('');
        else found[found.length - 1] += letter;
        depth += { '(': 1, ')': -1 }[letter] ?? 0;
    }
    return found;
}

/** By name: the names that it is computed from, those of functions among them. Order and branches are ignored. */
function flow(text) {
    const from = new Map();
    const add = (name, expression) => {
        if (!from.has(name)) from.set(name, new Set());
        for (const [each] of expression.matchAll(NAME)) from.get(name).add(each);
    };
    for (const [, name, body] of text.matchAll(/^\w+ (\w+)\([^)]*\) \{\n([\s\S]*?)^\}/gm)) {
        // A function counts as all that it reads.
        if (name !== 'main') add(name, body.replace(/\b_e\d+\b/g, ''));
        else for (const [, to, value] of body.matchAll(/^\s*(?:\w+ )?(\w+)[^=;\n]* = ([^;]*);/gm)) add(to, value);
    }
    // By the struct in which results are returned, each would be made of all.
    const [, struct, list] = /_tmp_return = (\w+)\((.*)\);/.exec(text) ?? [];
    const fields = struct && new RegExp(`struct ${struct} \\{([^}]*)\\}`).exec(text)[1].matchAll(/(\w+)(?:\[\d+\])?;/g);
    if (fields) {
        const values = split(list);
        for (const [i, [, field]] of [...fields].entries()) {
            const name = field.replace(/^own_(?=gl_)/, '');
            from.set(name, new Set());
            add(name, values[i] ?? '');
        }
    }
    return from;
}

/** All that `name` is computed from. */
function sources(from, name, found = new Set()) {
    for (const each of from.get(name) ?? []) {
        if (found.has(each)) continue;
        found.add(each);
        sources(from, each, found);
    }
    return found;
}

/** Whether a value is more than what three.js itself makes of positions and normals. */
function isBent(text, from, names) {
    const own = new Set(
        [...text.matchAll(/^(?:\w+ )*(?:uniform|in) [^;]*?(\w+)(?:\[\d+\])?;$/gm)].map(([, name]) => name),
    );
    const called = new Set([...text.matchAll(/(\w+)\(/g)].map(([, name]) => name));
    return [...names].some(
        (name) => (own.has(name) && !PLAIN.test(name)) || (called.has(name) && !from.has(name) && !STRAIGHT.test(name)),
    );
}

/** `{ vertex, fragment }` write the normal to the output `out`. */
export function bendsOnlyPositions({ vertex, fragment }, out) {
    const [moved, shaded] = [flow(vertex), flow(fragment)];
    if (!isBent(vertex, moved, sources(moved, 'gl_Position'))) return false;
    const read = sources(shaded, out);
    const varyings = new Set([...fragment.matchAll(/^.*\bin \w+ (\w+);$/gm)].map(([, name]) => name));
    const inFragment = [...read].filter((name) => !varyings.has(name));
    if (isBent(fragment, shaded, inFragment)) return false;
    return ![...varyings].some((name) => read.has(name) && isBent(vertex, moved, sources(moved, name)));
}
