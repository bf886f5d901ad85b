enable wgpu_mesh_shader;
struct TaskPayload { visible: bool }
var<task_payload> payload: TaskPayload;
@task @payload(payload) @workgroup_size(1) fn ts() -> @builtin(mesh_task_size) vec3<u32> {
    payload.visible = true;
    return vec3<u32>(1u, 1u, 1u);
}
