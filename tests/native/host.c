// See host.h. The arguments are the picture to write (PPM) and a file with a line for each GPU pass:
//
//   VERTEX ENTRY FRAGMENT ENTRY DEPTH COMPARE WRITE COLOUR CONSTANT SLOPE READ SET BINDING
//
// Shaders are SPIR-V files, `-` for none. DEPTH and READ number depth attachments: the one to draw
// with, and the one to bind as a texture at SET and BINDING, or -1. An attachment is cleared where it is first drawn to.
#include "host.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE = 256, DEPTHS = 2 };

#define VK(call) check((call), #call)

static void fail(const char *what) {
    fprintf(stderr, "%s\n", what);
    exit(1);
}

static void check(VkResult result, const char *call) {
    if (result != VK_SUCCESS) {
        fprintf(stderr, "%s: %d\n", call, result);
        exit(1);
    }
}

static VkPhysicalDevice physical;
static VkDevice device;
static VkQueue queue;
static VkCommandPool commands_pool;
static VkDescriptorPool descriptors;

// The driver on the CPU if there is one: its pictures are the same everywhere.
static void start(void) {
    VkInstance instance;
    const VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VK(vkCreateInstance(&(VkInstanceCreateInfo){.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                                .pApplicationInfo = &application},
                        NULL, &instance));
    VkPhysicalDevice all[8];
    uint32_t count = 8;
    if (vkEnumeratePhysicalDevices(instance, &count, all) < 0 || count == 0)
        fail("no Vulkan device: run scripts/setup.sh vulkan");
    physical = all[0];
    for (uint32_t i = 0; i < count; i++) {
        VkPhysicalDeviceProperties properties;
        vkGetPhysicalDeviceProperties(all[i], &properties);
        if (properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU)
            physical = all[i];
    }
    const VkDeviceQueueCreateInfo queues = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                            .queueCount = 1,
                                            .pQueuePriorities = (float[]){1}};
    VkPhysicalDeviceVulkan13Features rendering = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                                  .dynamicRendering = VK_TRUE};
    VK(vkCreateDevice(physical,
                      &(VkDeviceCreateInfo){.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                            .pNext = &rendering,
                                            .queueCreateInfoCount = 1,
                                            .pQueueCreateInfos = &queues},
                      NULL, &device));
    vkGetDeviceQueue(device, 0, 0, &queue);
    VK(vkCreateCommandPool(device, &(VkCommandPoolCreateInfo){.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO},
                           NULL, &commands_pool));
    const VkDescriptorPoolSize sizes[] = {{VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, 32},
                                          {VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 32},
                                          {VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 32},
                                          {VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE, 32}};
    VK(vkCreateDescriptorPool(device,
                              &(VkDescriptorPoolCreateInfo){.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                                            .maxSets = 32,
                                                            .poolSizeCount = 4,
                                                            .pPoolSizes = sizes},
                              NULL, &descriptors));
}

static VkDeviceMemory memory_of(VkMemoryRequirements needed, VkMemoryPropertyFlags wanted) {
    VkPhysicalDeviceMemoryProperties all;
    vkGetPhysicalDeviceMemoryProperties(physical, &all);
    uint32_t type = 0;
    while (type < all.memoryTypeCount &&
           !((needed.memoryTypeBits >> type & 1) && (all.memoryTypes[type].propertyFlags & wanted) == wanted))
        type++;
    VkDeviceMemory memory;
    VK(vkAllocateMemory(device,
                        &(VkMemoryAllocateInfo){.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                                .allocationSize = needed.size,
                                                .memoryTypeIndex = type},
                        NULL, &memory));
    return memory;
}

static VkBuffer mapped(size_t size, VkBufferUsageFlags usage, void **data) {
    VkBuffer buffer;
    VK(vkCreateBuffer(device,
                      &(VkBufferCreateInfo){.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = size, .usage = usage},
                      NULL, &buffer));
    VkMemoryRequirements needed;
    vkGetBufferMemoryRequirements(device, buffer, &needed);
    VkDeviceMemory memory =
        memory_of(needed, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    VK(vkBindBufferMemory(device, buffer, memory, 0));
    VK(vkMapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, data));
    return buffer;
}

VkBuffer buffer_of(const void *data, size_t size, VkBufferUsageFlags usage) {
    void *at;
    VkBuffer buffer = mapped(size, usage, &at);
    memcpy(at, data, size);
    return buffer;
}

static VkCommandBuffer begin(void) {
    VkCommandBuffer commands;
    VK(vkAllocateCommandBuffers(device,
                                &(VkCommandBufferAllocateInfo){.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                               .commandPool = commands_pool,
                                                               .commandBufferCount = 1},
                                &commands));
    VK(vkBeginCommandBuffer(commands, &(VkCommandBufferBeginInfo){.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO}));
    return commands;
}

static void end(VkCommandBuffer commands) {
    VK(vkEndCommandBuffer(commands));
    VK(vkQueueSubmit(queue, 1,
                     &(VkSubmitInfo){.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                                     .commandBufferCount = 1,
                                     .pCommandBuffers = &commands},
                     VK_NULL_HANDLE));
    VK(vkQueueWaitIdle(queue));
}

// Everything before is done and seen by everything after. All images stay in the general layout.
static void barrier(VkCommandBuffer commands) {
    const VkMemoryBarrier all = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                 .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                                 .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 1, &all,
                         0, NULL, 0, NULL);
}

typedef struct {
    VkImage image;
    VkImageView view;
} Image;

static VkImageAspectFlags aspect_of(VkFormat format) {
    return format == VK_FORMAT_D32_SFLOAT ? VK_IMAGE_ASPECT_DEPTH_BIT : VK_IMAGE_ASPECT_COLOR_BIT;
}

static Image image_of(VkFormat format, uint32_t size, VkImageUsageFlags usage) {
    Image out;
    VK(vkCreateImage(device,
                     &(VkImageCreateInfo){.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                                          .imageType = VK_IMAGE_TYPE_2D,
                                          .format = format,
                                          .extent = {size, size, 1},
                                          .mipLevels = 1,
                                          .arrayLayers = 1,
                                          .samples = VK_SAMPLE_COUNT_1_BIT,
                                          .tiling = VK_IMAGE_TILING_OPTIMAL,
                                          .usage = usage},
                     NULL, &out.image));
    VkMemoryRequirements needed;
    vkGetImageMemoryRequirements(device, out.image, &needed);
    VK(vkBindImageMemory(device, out.image, memory_of(needed, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT), 0));
    const VkImageSubresourceRange range = {aspect_of(format), 0, 1, 0, 1};
    VK(vkCreateImageView(device,
                         &(VkImageViewCreateInfo){.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                                  .image = out.image,
                                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                                  .format = format,
                                                  .subresourceRange = range},
                         NULL, &out.view));
    VkCommandBuffer commands = begin();
    const VkImageMemoryBarrier general = {.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER,
                                          .dstAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                                          .newLayout = VK_IMAGE_LAYOUT_GENERAL,
                                          .image = out.image,
                                          .subresourceRange = range};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT, 0, 0, NULL, 0,
                         NULL, 1, &general);
    end(commands);
    return out;
}

static VkBufferImageCopy whole(VkFormat format, uint32_t size) {
    return (VkBufferImageCopy){.imageSubresource = {aspect_of(format), 0, 0, 1}, .imageExtent = {size, size, 1}};
}

static void set_image(VkDescriptorSet set, uint32_t binding, uint32_t element, VkDescriptorType type, VkImageView view,
                      VkSampler sampler) {
    const VkDescriptorImageInfo info = {sampler, view, VK_IMAGE_LAYOUT_GENERAL};
    vkUpdateDescriptorSets(device, 1,
                           &(VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                                   .dstSet = set,
                                                   .dstBinding = binding,
                                                   .dstArrayElement = element,
                                                   .descriptorCount = 1,
                                                   .descriptorType = type,
                                                   .pImageInfo = &info},
                           0, NULL);
}

void set_texture(VkDescriptorSet set, uint32_t binding, uint32_t element, uint32_t size, const void *texels,
                 int compare) {
    VkFormat format = compare ? VK_FORMAT_D32_SFLOAT : VK_FORMAT_R8G8B8A8_UNORM;
    Image image = image_of(format, size, VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT);
    VkBuffer from = buffer_of(texels, (size_t)size * size * 4, VK_BUFFER_USAGE_TRANSFER_SRC_BIT);
    VkCommandBuffer commands = begin();
    const VkBufferImageCopy copy = whole(format, size);
    vkCmdCopyBufferToImage(commands, from, image.image, VK_IMAGE_LAYOUT_GENERAL, 1, &copy);
    barrier(commands);
    end(commands);
    VkSampler sampler;
    VK(vkCreateSampler(device,
                       &(VkSamplerCreateInfo){.sType = VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO,
                                              .compareEnable = compare != 0,
                                              .compareOp = VK_COMPARE_OP_LESS_OR_EQUAL},
                       NULL, &sampler));
    set_image(set, binding, element, VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, image.view, sampler);
}

void set_buffer(VkDescriptorSet set, uint32_t binding, VkDescriptorType type, const void *data, size_t size) {
    const VkBufferUsageFlags usage = VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT | VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    const VkDescriptorBufferInfo info = {buffer_of(data, size, usage), 0, VK_WHOLE_SIZE};
    vkUpdateDescriptorSets(device, 1,
                           &(VkWriteDescriptorSet){.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                                   .dstSet = set,
                                                   .dstBinding = binding,
                                                   .descriptorCount = 1,
                                                   .descriptorType = type,
                                                   .pBufferInfo = &info},
                           0, NULL);
}

// A line of the plan.
typedef struct {
    char shaders[2][1024], entries[2][256];
    int depth, compare, write, colour;
    float constant, slope;
    int read, set, binding;
} Pass;

static int read_pass(FILE *plan, Pass *pass) {
    int count = fscanf(plan, "%1023s %255s %1023s %255s %d %d %d %d %f %f %d %d %d", pass->shaders[VERTEX],
                       pass->entries[VERTEX], pass->shaders[FRAGMENT], pass->entries[FRAGMENT], &pass->depth,
                       &pass->compare, &pass->write, &pass->colour, &pass->constant, &pass->slope,
                       &pass->read, &pass->set, &pass->binding);
    if (count != EOF && (count != 13 || pass->depth >= DEPTHS || pass->read >= DEPTHS || pass->set >= SETS))
        fail("a line of the plan is not as expected");
    return count != EOF;
}

static VkPipelineLayout layout_of(const Pass *pass, VkDescriptorSet *sets) {
    VkDescriptorSetLayout layouts[SETS];
    for (int i = 0; i < SETS; i++) {
        VkDescriptorSetLayoutBinding bindings[BINDINGS + 1];
        uint32_t count = material.sets[i].count;
        memcpy(bindings, material.sets[i].bindings, sizeof material.sets[i].bindings);
        if (pass->read >= 0 && pass->set == i)
            bindings[count++] = (VkDescriptorSetLayoutBinding){
                (uint32_t)pass->binding, VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE, 1, VK_SHADER_STAGE_FRAGMENT_BIT, NULL};
        VK(vkCreateDescriptorSetLayout(
            device,
            &(VkDescriptorSetLayoutCreateInfo){.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                               .bindingCount = count,
                                               .pBindings = bindings},
            NULL, &layouts[i]));
    }
    VK(vkAllocateDescriptorSets(device,
                                &(VkDescriptorSetAllocateInfo){.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                                               .descriptorPool = descriptors,
                                                               .descriptorSetCount = SETS,
                                                               .pSetLayouts = layouts},
                                sets));
    VkPipelineLayout layout;
    VK(vkCreatePipelineLayout(device,
                              &(VkPipelineLayoutCreateInfo){.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                                            .setLayoutCount = SETS,
                                                            .pSetLayouts = layouts,
                                                            .pushConstantRangeCount = material.range_count,
                                                            .pPushConstantRanges = material.ranges},
                              NULL, &layout));
    return layout;
}

static VkShaderModule module_of(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file)
        fail(path);
    static uint32_t words[1 << 18];
    size_t count = fread(words, 4, sizeof words / 4, file);
    fclose(file);
    VkShaderModule module;
    VK(vkCreateShaderModule(device,
                            &(VkShaderModuleCreateInfo){.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO,
                                                        .codeSize = count * 4,
                                                        .pCode = words},
                            NULL, &module));
    return module;
}

static VkPipeline pipeline_of(const Pass *pass, VkPipelineLayout layout) {
    VkPipelineShaderStageCreateInfo stages[2];
    uint32_t count = 0;
    for (int i = 0; i < 2; i++) {
        if (strcmp(pass->shaders[i], "-") == 0)
            continue;
        stages[count++] = (VkPipelineShaderStageCreateInfo){
            .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
            .stage = i == VERTEX ? VK_SHADER_STAGE_VERTEX_BIT : VK_SHADER_STAGE_FRAGMENT_BIT,
            .module = module_of(pass->shaders[i]),
            .pName = pass->entries[i],
            .pSpecializationInfo = &material.specialisation[i]};
    }
    const VkFormat colour = VK_FORMAT_R8G8B8A8_UNORM;
    const VkPipelineRenderingCreateInfo rendering = {.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO,
                                                     .colorAttachmentCount = pass->colour,
                                                     .pColorAttachmentFormats = &colour,
                                                     .depthAttachmentFormat = VK_FORMAT_D32_SFLOAT};
    const VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
    const VkViewport viewport = {0, 0, SIZE, SIZE, 0, 1};
    const VkRect2D scissor = {{0, 0}, {SIZE, SIZE}};
    const VkPipelineViewportStateCreateInfo view = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                                    .viewportCount = 1,
                                                    .pViewports = &viewport,
                                                    .scissorCount = 1,
                                                    .pScissors = &scissor};
    const VkPipelineRasterizationStateCreateInfo raster = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
        .depthBiasEnable = pass->constant != 0 || pass->slope != 0,
        .depthBiasConstantFactor = pass->constant,
        .depthBiasSlopeFactor = pass->slope,
        .lineWidth = 1};
    const VkPipelineMultisampleStateCreateInfo samples = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
        .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
    const VkPipelineDepthStencilStateCreateInfo depth = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO,
        .depthTestEnable = VK_TRUE,
        .depthWriteEnable = pass->write,
        .depthCompareOp = pass->compare};
    const VkPipelineColorBlendAttachmentState all = {.colorWriteMask = 15};
    const VkPipelineColorBlendStateCreateInfo blend = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
        .attachmentCount = pass->colour,
        .pAttachments = &all};
    VkPipeline pipeline;
    VK(vkCreateGraphicsPipelines(device, VK_NULL_HANDLE, 1,
                                 &(VkGraphicsPipelineCreateInfo){.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                                                 .pNext = &rendering,
                                                                 .stageCount = count,
                                                                 .pStages = stages,
                                                                 .pVertexInputState = &material.input,
                                                                 .pInputAssemblyState = &assembly,
                                                                 .pViewportState = &view,
                                                                 .pRasterizationState = &raster,
                                                                 .pMultisampleState = &samples,
                                                                 .pDepthStencilState = &depth,
                                                                 .pColorBlendState = &blend,
                                                                 .layout = layout},
                                 NULL, &pipeline));
    return pipeline;
}

static void run(const Pass *pass, Image colour, const Image *depths, int is_first) {
    VkDescriptorSet sets[SETS];
    VkPipelineLayout layout = layout_of(pass, sets);
    fill(sets);
    if (pass->read >= 0)
        set_image(sets[pass->set], (uint32_t)pass->binding, 0, VK_DESCRIPTOR_TYPE_SAMPLED_IMAGE,
                  depths[pass->read].view, VK_NULL_HANDLE);
    VkPipeline pipeline = pipeline_of(pass, layout);
    VkCommandBuffer commands = begin();
    const VkRenderingAttachmentInfo target = {.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                              .imageView = colour.view,
                                              .imageLayout = VK_IMAGE_LAYOUT_GENERAL,
                                              .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                              .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                              .clearValue.color.float32 = {0.1f, 0.1f, 0.15f, 1}};
    const VkRenderingAttachmentInfo depth = {.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                             .imageView = depths[pass->depth].view,
                                             .imageLayout = VK_IMAGE_LAYOUT_GENERAL,
                                             .loadOp = is_first ? VK_ATTACHMENT_LOAD_OP_CLEAR
                                                                : VK_ATTACHMENT_LOAD_OP_LOAD,
                                             .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                             .clearValue.depthStencil.depth = 1};
    vkCmdBeginRendering(commands, &(VkRenderingInfo){.sType = VK_STRUCTURE_TYPE_RENDERING_INFO,
                                                     .renderArea.extent = {SIZE, SIZE},
                                                     .layerCount = 1,
                                                     .colorAttachmentCount = pass->colour,
                                                     .pColorAttachments = &target,
                                                     .pDepthAttachment = &depth});
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, layout, 0, SETS, sets, 0, NULL);
    draw(commands, layout);
    vkCmdEndRendering(commands);
    barrier(commands);
    end(commands);
}

static void write_picture(Image image, const char *path) {
    void *data;
    VkBuffer buffer = mapped(SIZE * SIZE * 4, VK_BUFFER_USAGE_TRANSFER_DST_BIT, &data);
    VkCommandBuffer commands = begin();
    const VkBufferImageCopy copy = whole(VK_FORMAT_R8G8B8A8_UNORM, SIZE);
    vkCmdCopyImageToBuffer(commands, image.image, VK_IMAGE_LAYOUT_GENERAL, buffer, 1, &copy);
    barrier(commands);
    end(commands);
    FILE *file = fopen(path, "wb");
    if (!file)
        fail(path);
    fprintf(file, "P6 %d %d 255\n", SIZE, SIZE);
    for (int i = 0; i < SIZE * SIZE; i++)
        fwrite((unsigned char *)data + 4 * i, 1, 3, file);
    fclose(file);
}

int main(int count, char **arguments) {
    FILE *plan = count == 3 ? fopen(arguments[2], "r") : NULL;
    if (!plan)
        fail("arguments: PICTURE PLAN");
    start();
    Image colour = image_of(VK_FORMAT_R8G8B8A8_UNORM, SIZE,
                            VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT);
    Image depths[DEPTHS];
    for (int i = 0; i < DEPTHS; i++)
        depths[i] = image_of(VK_FORMAT_D32_SFLOAT, SIZE,
                             VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT | VK_IMAGE_USAGE_SAMPLED_BIT);
    Pass pass;
    int used[DEPTHS] = {0};
    while (read_pass(plan, &pass))
        run(&pass, colour, depths, !used[pass.depth]++);
    write_picture(colour, arguments[1]);
    // The process ends here, and with it everything that it holds.
    return 0;
}
