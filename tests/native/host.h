// What the Vulkan hosts of this folder share: a device, resources, the GPU passes of a plan, and a
// picture. A host defines `material`, `fill` and `draw`; `main` is in host.c.
#pragma once
#include <stddef.h>
#include <vulkan/vulkan.h>

enum { SETS = 3, BINDINGS = 4, VERTEX = 0, FRAGMENT = 1 };

typedef struct {
    uint32_t count;
    VkDescriptorSetLayoutBinding bindings[BINDINGS];
} Set;

// The author's pipeline: nothing in it is taken from a shader.
typedef struct {
    Set sets[SETS];
    uint32_t range_count;
    VkPushConstantRange ranges[2];
    VkSpecializationInfo specialisation[2];
    VkPipelineVertexInputStateCreateInfo input;
} Material;

extern const Material material;

// Writes the author's descriptors.
void fill(const VkDescriptorSet *sets);
// Records the author's draw calls.
void draw(VkCommandBuffer commands, VkPipelineLayout layout);

VkBuffer buffer_of(const void *data, size_t size, VkBufferUsageFlags usage);
void set_buffer(VkDescriptorSet set, uint32_t binding, VkDescriptorType type, const void *data, size_t size);
// A square texture of 4 bytes a texel, as a combined image sampler. `compare` for a depth texture.
void set_texture(VkDescriptorSet set, uint32_t binding, uint32_t element, uint32_t size, const void *texels,
                 int compare);
