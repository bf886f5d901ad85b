// Draws cubes that overlap: instances from a storage block, specialisation constants that each
// stage maps on its own, and a comparison with a depth texture.
#include "host.h"

#define STAGE(stage) VK_SHADER_STAGE_##stage##_BIT
#define UNIFORM VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER
#define STORAGE VK_DESCRIPTOR_TYPE_STORAGE_BUFFER
#define SAMPLED VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER

static const struct {
    float spread;
    uint32_t axis;
} of_vertex = {1.5f, 1};
static const struct {
    int32_t shade;
    uint32_t steps, cut;
    int32_t bands;
} of_fragment = {2, 3, 1, 4};
static const VkSpecializationMapEntry entries[2][4] = {
    {{3, 0, 4}, {4, 4, 4}},
    {{7, 8, 4}, {9, 4, 4}, {3, 0, 4}, {5, 12, 4}},
};

static const VkVertexInputBindingDescription stride = {0, 12, VK_VERTEX_INPUT_RATE_VERTEX};
static const VkVertexInputAttributeDescription position = {1, 0, VK_FORMAT_R32G32B32_SFLOAT, 0};

const Material material = {
    .sets = {[0] = {2, {{2, UNIFORM, 1, STAGE(VERTEX), NULL}, {5, STORAGE, 1, STAGE(VERTEX), NULL}}},
             [1] = {3,
                    {{0, STORAGE, 1, STAGE(FRAGMENT), NULL},
                     {1, UNIFORM, 1, STAGE(FRAGMENT), NULL},
                     {3, SAMPLED, 1, STAGE(FRAGMENT), NULL}}}},
    .specialisation = {{2, entries[VERTEX], sizeof of_vertex, &of_vertex},
                       {4, entries[FRAGMENT], sizeof of_fragment, &of_fragment}},
    .input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
              .vertexBindingDescriptionCount = 1,
              .pVertexBindingDescriptions = &stride,
              .vertexAttributeDescriptionCount = 1,
              .pVertexAttributeDescriptions = &position},
};

enum { FIRST = 2, COUNT = 7, SIDE = 64 };

void fill(const VkDescriptorSet *sets) {
    static const struct {
        float projection[16], light[16];
    } frame = {
        .projection = {0.55f, 0.12f, 0.05f, 0, -0.1f, 0.6f, -0.04f, 0, -0.3f, 0.2f, 0.1f, 0.05f, 0, 0, 0.5f, 1},
        .light = {0.3f, 0.1f, 0, 0, 0, 0.3f, 0, 0, 0, 0.1f, 0.2f, 0, 0.5f, 0.5f, 0.5f, 1},
    };
    struct {
        float shift[4];
        struct {
            float model[16], hue[4];
        } bodies[FIRST + COUNT];
    } crowd = {.shift = {0.05f, -0.1f, 0, 0}};
    for (int i = 0; i < FIRST + COUNT; i++) {
        float t = (float)(i - FIRST) - 3, size = 0.25f + 0.02f * (float)i;
        float model[16] = {size, 0.05f * t, 0, 0, -0.05f * t, size, 0.1f, 0, 0, -0.1f, size, 0,
                           0.3f * t, 0.1f * t * t - 0.4f, 0.2f * t, 1};
        for (int k = 0; k < 16; k++)
            crowd.bodies[i].model[k] = model[k];
        for (int k = 0; k < 3; k++)
            crowd.bodies[i].hue[k] = 0.3f + 0.1f * (float)((i * (k + 2)) % 7);
        crowd.bodies[i].hue[3] = 1;
    }
    static const struct {
        float bias, unused[3], steps[3][4];
    } ramp = {.bias = 0.01f, .steps = {{1.2f, 0.4f, 0.8f}, {0.6f, 1.4f, 0.2f}, {1, 0.9f, 1.8f}}};
    // Twice as many as the constant's default.
    static const struct {
        float last[4], bands[4][4];
    } banding = {.last = {0.4f, 0.4f, 0.4f},
                 .bands = {{0.1f, 0, 0.2f, 0.1f}, {0.2f, 0.1f, 0, 0.3f}, {0, 0.3f, 0.1f, 0.5f}, {0.3f, 0, 0.4f, 0.7f}}};
    float depths[SIDE * SIDE];
    for (int i = 0; i < SIDE * SIDE; i++)
        depths[i] = (i / SIDE / 8 + i % SIDE / 8) % 2 ? 0.45f : 0.8f;
    set_buffer(sets[0], 2, UNIFORM, &frame, sizeof frame);
    set_buffer(sets[0], 5, STORAGE, &crowd, sizeof crowd);
    set_buffer(sets[1], 0, STORAGE, &ramp, sizeof ramp);
    set_buffer(sets[1], 1, UNIFORM, &banding, sizeof banding);
    set_texture(sets[1], 3, 0, SIDE, depths, 1);
}

void draw(VkCommandBuffer commands, VkPipelineLayout layout) {
    (void)layout;
    float cube[36][3];
    for (int i = 0; i < 36; i++) {
        // Two triangles of the side of an axis.
        int side = i / 6, axis = side / 2, corner = (int[]){0, 1, 2, 2, 1, 3}[i % 6];
        cube[i][axis] = side % 2 ? 1 : -1;
        cube[i][(axis + 1) % 3] = corner % 2 ? 1 : -1;
        cube[i][(axis + 2) % 3] = corner / 2 ? 1 : -1;
    }
    VkBuffer vertices = buffer_of(cube, sizeof cube, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT);
    vkCmdBindVertexBuffers(commands, 0, 1, &vertices, &(VkDeviceSize){0});
    // An index of an instance counts from the first one.
    vkCmdDraw(commands, 36, COUNT, 0, FIRST);
}
