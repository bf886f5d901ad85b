// The worker of node.

import { parentPort, workerData } from 'node:worker_threads';
import { failure, Instance } from './instance.js';
import { module } from './module-node.js';

let instance;

parentPort.on('message', ({ id, request }) => {
    let answer;
    try {
        instance ??= new Instance(module(workerData.wasm));
        answer = instance.call(request);
    } catch (error) {
        answer = { error: failure('worker', `the module cannot be loaded: ${error.message}`) };
    }
    parentPort.postMessage({ id, answer });
});
