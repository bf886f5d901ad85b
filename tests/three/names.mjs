// TEMPORARY: naga's names to the author's.
import { readFile, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
export async function authorNames(path) {
    const plan = JSON.parse(await readFile(path, 'utf8'));
    const sets = [[plan.passes, plan.files]];
    if (plan.original) sets.push([plan.original.passes, plan.original.files]);
    const done = new Set();
    for (const [passes, files] of sets)
        for (const [i, pass] of passes.entries())
            for (const stage of ['vertex', 'fragment']) {
                const of = files[i][stage]['glsl-es'];
                const rename = new Map();
                for (const t of of.textures ?? []) {
                    const b = pass.bindings.find((b) => b.group === t.texture[0] && b.binding === t.texture[1]);
                    if (b) {
                        rename.set(t.name, b.name);
                        t.name = b.name;
                    }
                }
                if (done.has(of.file)) continue;
                done.add(of.file);
                const file = join(dirname(path), of.file);
                let s = await readFile(file, 'utf8');
                for (const a of pass.attributes) rename.set(`_p2vs_location${a.location}`, a.name);
                if (stage === 'fragment')
                    for (const k of [...rename.keys()]) if (k.startsWith('_p2vs')) rename.delete(k);
                // locals of the same name give way
                for (const [from, to] of rename) {
                    const cut = s.indexOf('layout(');
                    s = (
                        s.slice(0, cut) + s.slice(cut).replace(new RegExp(`(?<![.])\\b${to}\\b`, 'g'), `${to}_l`)
                    ).replaceAll(new RegExp(`\\b${from}\\b`, 'g'), to);
                }
                const block = /layout\(std140\) uniform (\w+) \{ (\w+) (\w+); \};/.exec(s);
                if (block) {
                    const members = new RegExp(`struct ${block[2]} \\{([^}]*)\\}`)
                        .exec(s)[1]
                        .split(';')
                        .map((m) => m.trim())
                        .filter(Boolean);
                    const names = members.map((m) => /(\w+)(\[.*\])?$/.exec(m)[1]);
                    const body = s
                        .slice(block.index + block[0].length)
                        .replaceAll(block[3], `${block[2]}(${names.join(', ')})`);
                    const fixed = names.reduce(
                        (t, n) => t.replace(new RegExp(`(?<![.(,] ?)\\b${n}\\b(?! ?[,)])`, 'g'), `${n}_l`),
                        body,
                    );
                    s = s.slice(0, block.index) + members.map((m) => `uniform ${m};`).join('\n') + body;
                }
                s = s.replaceAll(/(?<=[. ])distance_\b/g, 'distance');
                s = s.replace(/\w+\.z = \(\((_e\d+)\.z \+ (_e\d+)\.w\) \* 0\.5\);/, '');
                await writeFile(file, s);
            }
    await writeFile(path, JSON.stringify(plan, null, 2));
}
