// The visitor's text, and the two texts of a comparison: CodeMirror.

import { defaultKeymap, history, historyKeymap } from '@codemirror/commands';
import { bracketMatching, HighlightStyle, StreamLanguage, syntaxHighlighting } from '@codemirror/language';
import { clike, shader } from '@codemirror/legacy-modes/mode/clike';
import { lintGutter, lintKeymap, setDiagnostics } from '@codemirror/lint';
import {
    getChunks,
    getOriginalDoc,
    goToNextChunk,
    goToPreviousChunk,
    MergeView,
    unifiedMergeView,
} from '@codemirror/merge';
import { highlightSelectionMatches, search, searchKeymap } from '@codemirror/search';
import { EditorState } from '@codemirror/state';
import { EditorView, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers } from '@codemirror/view';
import { tags } from '@lezer/highlight';

const words = (text) => Object.fromEntries(text.split(' ').map((word) => [word, true]));

const WGSL = {
    name: 'wgsl',
    keywords: words(
        'alias break case const const_assert continue continuing default diagnostic discard else enable fn for if let ' +
            'loop override requires return struct switch var while function private workgroup uniform storage',
    ),
    types: words(
        'bool f16 f32 i32 u32 vec2 vec3 vec4 vec2f vec3f vec4f vec2i vec3i vec4i vec2u vec3u vec4u mat2x2 mat3x3 mat4x4 ' +
            'mat2x3 mat2x4 mat3x2 mat3x4 mat4x2 mat4x3 mat2x2f mat3x3f mat4x4f array atomic ptr sampler ' +
            'sampler_comparison texture_2d texture_3d texture_cube texture_2d_array texture_depth_2d ' +
            'texture_storage_2d texture_multisampled_2d',
    ),
    blockKeywords: words('else for if loop switch while continuing fn struct'),
    atoms: words('true false'),
    hooks: {
        '@'(stream) {
            stream.eatWhile(/\w/);
            return 'meta';
        },
    },
};

const LANGUAGES = { wgsl: StreamLanguage.define(clike(WGSL)), glsl: StreamLanguage.define(shader) };

// Colours are the page's, so that dark and light need no second theme.
const COLOURS = HighlightStyle.define([
    { tag: tags.comment, color: 'var(--code-comment)', fontStyle: 'italic' },
    { tag: [tags.keyword, tags.controlKeyword], color: 'var(--code-keyword)' },
    { tag: [tags.typeName, tags.standard(tags.typeName)], color: 'var(--code-type)' },
    { tag: [tags.number, tags.atom, tags.bool, tags.string], color: 'var(--code-number)' },
    { tag: [tags.meta, tags.processingInstruction], color: 'var(--code-meta)' },
]);

const common = (language, label) => [
    lineNumbers(),
    bracketMatching(),
    LANGUAGES[language],
    syntaxHighlighting(COLOURS),
    search({ top: true }),
    EditorView.contentAttributes.of({ 'aria-label': label, tabindex: '0', spellcheck: 'false', autocapitalize: 'off' }),
    EditorState.tabSize.of(4),
];

/** An editor of the visitor's text. `changed` hears whether a text was pasted or dropped. Tab is not taken: it leads on, as everywhere in the page. */
export class SourceEditor {
    #view;

    constructor(parent, { text, language, label, changed }) {
        const listener = EditorView.updateListener.of((update) => {
            if (!update.docChanged) return;
            changed(update.transactions.some((of) => of.isUserEvent('input.paste') || of.isUserEvent('input.drop')));
        });
        this.#view = new EditorView({
            parent,
            state: EditorState.create({
                doc: text,
                extensions: [
                    common(language, label),
                    history(),
                    highlightActiveLine(),
                    highlightActiveLineGutter(),
                    highlightSelectionMatches(),
                    lintGutter(),
                    keymap.of([...defaultKeymap, ...historyKeymap, ...searchKeymap, ...lintKeymap]),
                    listener,
                ],
            }),
        });
    }

    get text() {
        return this.#view.state.doc.toString();
    }

    /** Marks places: `{ place, severity, message }`. */
    mark(found) {
        const { text } = this;
        const bytes = new TextEncoder().encode(text);
        const decoder = new TextDecoder();
        const at = (byte) => decoder.decode(bytes.subarray(0, Math.min(byte, bytes.length))).length;
        const diagnostics = found.map(({ place, severity, message, source }) => {
            const from = at(place.range.start);
            return { from, to: Math.max(from, at(place.range.end)), severity, message, source };
        });
        this.#view.dispatch(setDiagnostics(this.#view.state, diagnostics));
    }

    /** Brings a line into view, with the focus on it. */
    goTo({ line, column = 1 }) {
        const { doc } = this.#view.state;
        const found = doc.line(Math.min(Math.max(line, 1), doc.lines));
        const anchor = Math.min(found.from + column - 1, found.to);
        this.#view.dispatch({ selection: { anchor }, effects: EditorView.scrollIntoView(anchor, { y: 'center' }) });
        this.#view.focus();
    }

    destroy() {
        this.#view.destroy();
    }
}

/** Work spent on finding a small difference: a text of a megabyte is compared line by line instead. */
const DIFF = { scanLimit: 2000, timeout: 1500 };

/** Two texts beside each other, or in one column where there is no room. */
export class Comparison {
    #view;
    #isSplit;

    constructor(parent, { before, after, language, labels, split }) {
        const fixed = [EditorState.readOnly.of(true), keymap.of([...searchKeymap, ...defaultKeymap])];
        const of = (label) => [common(language, label), fixed];
        this.#isSplit = split;
        if (split) {
            this.#view = new MergeView({
                parent,
                a: { doc: before, extensions: of(labels[0]) },
                b: { doc: after, extensions: of(labels[1]) },
                collapseUnchanged: { margin: 3, minSize: 6 },
                diffConfig: DIFF,
                gutter: true,
            });
        } else {
            const merge = unifiedMergeView({
                original: before,
                mergeControls: false,
                collapseUnchanged: { margin: 3, minSize: 6 },
                diffConfig: DIFF,
            });
            this.#view = new EditorView({
                parent,
                state: EditorState.create({ doc: after, extensions: [of(`${labels[1]}, with changes`), merge] }),
            });
        }
    }

    get #last() {
        return this.#isSplit ? this.#view.b : this.#view;
    }

    /** Lines taken out and put in, and in how many places. */
    get counts() {
        const { chunks = [] } = getChunks(this.#last.state) ?? {};
        const { doc } = this.#last.state;
        const before = this.#isSplit ? this.#view.a.state.doc : getOriginalDoc(this.#last.state);
        const lines = (text, from, to) =>
            from >= to ? 0 : text.lineAt(Math.min(to - 1, text.length)).number - text.lineAt(from).number + 1;
        const out = { places: chunks.length, removed: 0, added: 0 };
        for (const { fromA, toA, fromB, toB } of chunks) {
            out.removed += lines(before, fromA, toA);
            out.added += lines(doc, fromB, toB);
        }
        return out;
    }

    next() {
        goToNextChunk(this.#last);
        this.#last.focus();
    }

    previous() {
        goToPreviousChunk(this.#last);
        this.#last.focus();
    }

    destroy() {
        this.#view.destroy();
    }
}
