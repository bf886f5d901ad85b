// Draws textured quads: combined image samplers in two sets, one an array, blocks with offsets and
// row-major matrices, and push constants of which each stage has its own part.
#include "host.h"

#define STAGE(stage) VK_SHADER_STAGE_##stage##_BIT
#define UNIFORM VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER
#define SAMPLED VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER

typedef struct {
    float position[3], uv[2];
} Vertex;

static const VkVertexInputBindingDescription stride = {0, sizeof(Vertex), VK_VERTEX_INPUT_RATE_VERTEX};
static const VkVertexInputAttributeDescription attributes[] = {
    {0, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(Vertex, position)},
    {3, 0, VK_FORMAT_R32G32_SFLOAT, offsetof(Vertex, uv)},
};

const Material material = {
    .sets = {[0] = {2, {{1, UNIFORM, 1, STAGE(VERTEX), NULL}, {3, SAMPLED, 1, STAGE(FRAGMENT), NULL}}},
             [2] = {2, {{0, UNIFORM, 1, STAGE(FRAGMENT), NULL}, {3, SAMPLED, 3, STAGE(FRAGMENT), NULL}}}},
    .range_count = 2,
    .ranges = {{STAGE(VERTEX), 16, 24}, {STAGE(FRAGMENT), 48, 24}},
    .input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
              .vertexBindingDescriptionCount = 1,
              .pVertexBindingDescriptions = &stride,
              .vertexAttributeDescriptionCount = 2,
              .pVertexAttributeDescriptions = attributes},
};

// A checkerboard of `light` and `dark`, with holes in the dark squares.
static void set_checks(VkDescriptorSet set, uint32_t binding, uint32_t element, uint32_t light, uint32_t dark) {
    enum { SIDE = 32 };
    uint32_t texels[SIDE * SIDE];
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            int is_hole = x % 8 > 2 && x % 8 < 6 && y % 8 > 2 && y % 8 < 6;
            uint32_t texel = (x / 8 + y / 8) % 2 ? dark & (is_hole ? 0x00ffffff : 0xffffffff) : light;
            texels[y * SIDE + x] = texel + (uint32_t)(x + 256 * y);
        }
    set_texture(set, binding, element, SIDE, texels, 0);
}

void fill(const VkDescriptorSet *sets) {
    struct {
        float unused[8], projection[16], gap[8];
        // Rows of 4.
        float view[16], atlas[2][4], tilts[2][4][4];
    } camera = {
        .projection = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.5f, 0.4f, 0, 0, 0.25f, 1},
        .view = {0.96f, -0.28f, 0, 0.05f, 0.28f, 0.96f, 0, 0.1f, 0, 0, 1, 0.2f, 0, 0, 0, 1},
        .atlas = {{0.9f, 0.1f, 0.03f}, {-0.2f, 0.8f, 0.11f}},
        .tilts = {{{0, 0.1f}, {0, -0.2f}, {0, 0.05f}, {0, 0.02f}}, {{0, 0.2f}, {0.03f, -0.1f}}},
    };
    struct {
        float low[4], unused[8], hues[3][4], gap[4], strength;
    } paint = {
        .low = {0.1f, 0.2f, 0.6f, 1},
        .hues = {{0.9f, 0.2f, 0}, {0.1f, 0.7f, 0.3f}, {0.5f, 0, 0.6f}},
        .strength = 0.35f,
    };
    set_buffer(sets[0], 1, UNIFORM, &camera, sizeof camera);
    set_checks(sets[0], 3, 0, 0xff40e0f0, 0xff205080);
    set_buffer(sets[2], 0, UNIFORM, &paint, sizeof paint);
    const uint32_t lights[] = {0xff2020e0, 0xff20e020, 0xffe02020};
    for (uint32_t i = 0; i < 3; i++)
        set_checks(sets[2], 3, i, lights[i], 0xffd0d0d0);
}

void draw(VkCommandBuffer commands, VkPipelineLayout layout) {
    static const Vertex quad[] = {
        {{-1, -1, 0}, {0, 0}}, {{1, -1, 0.4f}, {1, 0}}, {{-1, 1, 0}, {0, 1}},
        {{-1, 1, 0}, {0, 1}},  {{1, -1, 0.4f}, {1, 0}}, {{1, 1, 0.4f}, {1, 1}},
    };
    VkBuffer vertices = buffer_of(quad, sizeof quad, VK_BUFFER_USAGE_VERTEX_BUFFER_BIT);
    vkCmdBindVertexBuffers(commands, 0, 1, &vertices, &(VkDeviceSize){0});
    struct {
        float shift[4], lean;
        int tilt;
    } places[] = {{{-0.3f, -0.4f, 0.5f, 0.6f}, 0.1f, 0},
                  {{0.1f, 0, 0.4f, 0.7f}, -0.2f, 1},
                  {{0, 0.2f, 0.2f, 0.4f}, 0.3f, 1}};
    struct {
        float tint[4], cutoff;
        int layer;
    } looks[] = {{{1, 1, 1, 1}, 0.5f, 2}, {{1, 0.8f, 0.6f, 1}, 0.5f, 0}, {{0.7f, 1, 0.9f, 1}, -1, 1}};
    // The farthest first, so that fragments hide others.
    for (int i = 0; i < 3; i++) {
        vkCmdPushConstants(commands, layout, STAGE(VERTEX), 16, sizeof places[i], &places[i]);
        vkCmdPushConstants(commands, layout, STAGE(FRAGMENT), 48, sizeof looks[i], &looks[i]);
        vkCmdDraw(commands, 6, 1, 0, 0);
    }
}
