// preshade in a scene of @react-three/fiber: one component, which draws nothing.

import { useEffect, useRef } from 'react';
import { useFrame, useThree } from '@react-three/fiber';
import { Preshade as Host } from './index.js';

/** Frames between two looks at the report. */
const REPORT_EVERY = 30;
const PARTS = ['shadows', 'prepass', 'velocity'];

/**
 * `<Preshade shadows prepass={{ measure: true }} velocity onReady={..} onReport={..} />` within a `Canvas`.
 *
 * `shadows`, `prepass` and `velocity` are true, or the options of those functions. `scene` is another scene than the canvas's. `options` are those of `Preshade.of`. `onReady` is given
 * `{ preshade, prepass, velocity }`, and `onReport` the rows of the report whenever they are others. Errors go to `onError`, or to the console.
 */
export function Preshade({ shadows, prepass, velocity, scene, options, onReady, onReport, onError }) {
    const renderer = useThree((state) => state.gl);
    const root = useThree((state) => state.scene);
    const target = scene ?? root;
    const wanted = { shadows, prepass, velocity };
    // Objects that are written in place are others in each render, though they say the same.
    const asked = `${JSON.stringify(wanted)} ${JSON.stringify(options)}`;
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
                const of = wanted[name];
                if (of) parts[name] = host[name](target, of === true ? undefined : of);
            }
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
    }, [renderer, target, asked]);
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
