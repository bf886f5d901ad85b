// ECharts GL: bars with lights and shadows, ambient occlusion
// Drawn with WebGL.

import * as echarts from 'echarts';
import 'echarts-gl';
import { height, loaded, random, width, withoutCanvas } from './common.js';

withoutCanvas();
const holder = document.createElement('div');
holder.style.cssText = `width:${width}px;height:${height}px`;
document.body.append(holder);
const next = random(4);
const data = Array.from({ length: 64 }, (_, i) => [i % 8, Math.floor(i / 8), next() * 10]);
const chart = echarts.init(holder, null, { width, height });
chart.setOption({
    backgroundColor: '#223',
    visualMap: { max: 10, inRange: { color: ['#339', '#6c6', '#e93'] }, show: false },
    xAxis3D: { type: 'value' },
    yAxis3D: { type: 'value' },
    zAxis3D: { type: 'value' },
    grid3D: {
        viewControl: { autoRotate: true, autoRotateSpeed: 20 },
        light: { main: { intensity: 1.2, shadow: true }, ambient: { intensity: 0.3 } },
        postEffect: { enable: true, SSAO: { enable: true, radius: 4 } },
    },
    series: [{ type: 'bar3D', data, shading: 'lambert' }],
});
setTimeout(loaded, 1500);
