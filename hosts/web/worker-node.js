// The worker of node.

import { parentPort, workerData } from 'node:worker_threads';
import { failure, Instances } from './instance.js';
import { module } from './module-node.js';

const instances = new Instances((isFull) => module(workerData, isFull));

parentPort.on('message', ({ id, request }) => {
    let answer;
    try {
        answer = instances.of(request).call(request);
    } catch (error) {
        answer = { error: failure('worker', `the module cannot be loaded: ${error.message}`) };
    }
    parentPort.postMessage({ id, answer });
});
