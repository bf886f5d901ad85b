// The tables of docs/results/captures.md, each between two markers.

/** Puts `text` between the markers of `name`. */
export function placed(report, name, text) {
    const [begin, end] = [`<!-- ${name}: written by tests/capture/survey -->`, `<!-- end of ${name} -->`];
    const [from, to] = [report.indexOf(begin), report.indexOf(end)];
    if (from < 0 || to < from) throw new Error(`the report has no markers of ${name}`);
    return `${report.slice(0, from + begin.length)}\n${text}${report.slice(to)}`;
}

const WORDS = { 0: 'holds', 1: 'broken', 2: 'error', 3: 'not measured' };

/** What `verify` says. Most that is not measured is refused by every material: blended, or without depth. */
function verdict({ status, why = '' }) {
    const isRefused = status === 3 && why.includes('every material refuses it');
    return isRefused && !/not measured: (?!every material refuses it)/.test(why) ? 'all refuse' : (WORDS[status] ?? 'ended');
}

export function isWhole({ error, refused, swiftshader }) {
    const differs = swiftshader?.differ?.some(Boolean) ?? true;
    return !error && !refused.length && !swiftshader.left?.length && !differs;
}

/** A row of a page for each page, and what they add up to. */
export function table(rows) {
    const whole = rows.filter(isWhole).length;
    const captured = rows.filter(({ error }) => !error);
    const held = captured.filter(({ verify }) => verify.status === 0).length;
    const lines = rows.map((row) => {
        const { page, title, api, draws, swiftshader: ours, llvmpipe, refused, verify, error } = row;
        if (error) return `| \`${page}\` | ${title} | | | not captured: ${cell(error)} | | | |\n`;
        const left = [...refused, ...(ours.left ?? [])].map((what) => cell(what.split(': ').slice(0, 2).join(': ')));
        const differ = ours.error ? 'not replayed' : String(Math.max(...ours.differ));
        const more = llvmpipe.error ? 'not replayed' : String(Math.max(...llvmpipe.more));
        const named = [...new Set([...left, ...(ours.error ? [cell(ours.error)] : [])])].slice(0, 2).join('; ');
        const cells = [`\`${page}\``, title, api, draws, differ, ours.error ? '' : ours.most, more, named, verdict(verify)];
        return `| ${cells.join(' | ')} |\n`;
    });
    return `
${whole} of ${rows.length} pages are replayed whole: nothing is left out, and no pixel differs. ${captured.length} are captured. \`verify\` measures
both variants of ${held}, and each keeps its promise.

| page | what it shows | API | draws | pixels that differ | largest difference | llvmpipe: pixels by more than 1 | left out | \`verify\` |
|---|---|---|--:|--:|--:|--:|---|---|
${lines.join('')}
`;
}

function cell(text) {
    return text.replaceAll('|', '\\|').replaceAll('\n', ' ').slice(0, 140);
}
