// preshade in a scene of @react-three/fiber: one component, which draws nothing.

import { useEffect, useRef } from 'react';
import { useFrame, useThree } from '@react-three/fiber';
import { Preshade as Host } from './index.js';

/** Frames between two looks at the report. */
const REPORT_EVERY = 30;
const PARTS = ['shadows', 'prepass', 'rewrite', 'velocity'];

/**
 * `<Preshade shadows prepass={{ measure: true }} override={pass} onReady={..} onReport={..} />` within a `Canvas`. fiber.d.ts describes the properties.
 *
 * It begins anew where options are others than in the render before. See `same`.
 */
export function Preshade({ override, scene, options, onReady, onReport, onError, ...props }) {
    const renderer = useThree((state) => state.gl);
    const root = useThree((state) => state.scene);
    const target = scene ?? root;
    const passes = useKept(
        [override ?? []].flat().map((each) => [each].flat()),
        ofSame,
    );
    const asked = useKept([options, ...PARTS.map((name) => props[name])]);
    const made = useRef(null);
    const calls = useRef(null);
    useEffect(() => {
        calls.current = { onReady, onReport, onError };
    });
    useEffect(() => {
        let isGone = false;
        let preshade = null;
        const begin = async () => {
            const host = await Host.of(renderer, options);
            if (isGone) return host.dispose();
            preshade = host;
            const parts = {};
            for (const name of PARTS) {
                const of = props[name];
                if (of) parts[name] = host[name](target, of === true ? undefined : of);
            }
            for (const of of passes) host.override(...of);
            made.current = { preshade, ...parts, frames: 0, told: '' };
            calls.current.onReady?.({ preshade, ...parts });
        };
        begin().catch((error) => {
            preshade?.dispose();
            preshade = null;
            if (calls.current.onError) calls.current.onError(error);
            else console.error(error);
        });
        return () => {
            isGone = true;
            made.current = null;
            preshade?.dispose();
        };
    }, [renderer, target, passes, asked]);
    useFrame(() => {
        const of = made.current;
        if (!of || !calls.current.onReport || of.frames++ % REPORT_EVERY > 0) return;
        const rows = of.preshade.report();
        const text = JSON.stringify(rows);
        if (text === of.told) return;
        of.told = text;
        calls.current.onReport(rows);
    });
    return null;
}

/** The value of an earlier render, as long as it is equal. */
function useKept(value, equal = same) {
    const kept = useRef(value);
    if (!equal(kept.current, value)) kept.current = value;
    return kept.current;
}

/**
 * Whether two values of a property are one: lists and objects that are written in place are compared by what is in them, addresses by their text, and materials, cameras and the like
 * by identity. Two functions count as one: in each render they are others.
 */
function same(a, b) {
    if (Object.is(a, b) || (typeof a === 'function' && typeof b === 'function')) return true;
    if (a instanceof URL && b instanceof URL) return a.href === b.href;
    if (!isWritten(a) || !isWritten(b) || Array.isArray(a) !== Array.isArray(b)) return false;
    const names = Object.keys(a);
    if (names.length !== Object.keys(b).length) return false;
    return names.every((name) => Object.hasOwn(b, name) && same(a[name], b[name]));
}

/** Whether two lists have the same passes, with the same options. */
const ofSame = (a, b) => a.length === b.length && a.every(([pass, of], i) => pass === b[i][0] && same(of, b[i][1]));

/** A list, or an object of no class. */
const isWritten = (value) =>
    Array.isArray(value) ||
    (value !== null && typeof value === 'object' && prototypes.has(Object.getPrototypeOf(value)));
const prototypes = new Set([Object.prototype, null]);
