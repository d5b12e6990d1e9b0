// GPU memory of a simulation, and what tools in contact, self-contact and saved states add to it. Each row has the mean
// of several simulations of one model.
//
// Usage:
//   bench_memory [cells]     default: 14 cells along each axis, 13,720 tetrahedra
// With more than 14 cells (a multiple of 4), the method is averaged, with elements of 4 cells. 60 cells: 1.08 million
// tetrahedra.
//
// Columns:
//   allocated    sum of the blocks that the library holds
//   taken        memory that the device lacks (cudaMemGetInfo), which the driver hands out in blocks of 2 MiB
//   host         memory that the library holds on the host
#include "../pipeline/body.h"
#include "base/memory.h"
#include "figure.h"
#include "pliant/state.h"

#include <cuda_runtime.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <mutex>

namespace
{

// Device blocks by their address. The linker replaces the calls of the library by the functions below.
std::mutex blocks_lock;
std::map<void *, size_t> blocks;

void add_block(cudaError_t error, void *block, size_t bytes)
{
    std::lock_guard<std::mutex> lock(blocks_lock);
    if (error == cudaSuccess) blocks[block] = bytes;
}

void remove_block(void *block)
{
    std::lock_guard<std::mutex> lock(blocks_lock);
    blocks.erase(block);
}

} // namespace

extern "C" {
cudaError_t __real_cudaMalloc(void **out, size_t bytes);
cudaError_t __real_cudaFree(void *block);
cudaError_t __real_cudaMallocFromPoolAsync(void **out, size_t bytes, cudaMemPool_t pool, cudaStream_t stream);
cudaError_t __real_cudaFreeAsync(void *block, cudaStream_t stream);

cudaError_t __wrap_cudaMalloc(void **out, size_t bytes)
{
    const cudaError_t error = __real_cudaMalloc(out, bytes);
    add_block(error, *out, bytes);
    return error;
}

cudaError_t __wrap_cudaFree(void *block)
{
    remove_block(block);
    return __real_cudaFree(block);
}

cudaError_t __wrap_cudaMallocFromPoolAsync(void **out, size_t bytes, cudaMemPool_t pool, cudaStream_t stream)
{
    const cudaError_t error = __real_cudaMallocFromPoolAsync(out, bytes, pool, stream);
    add_block(error, *out, bytes);
    return error;
}

cudaError_t __wrap_cudaFreeAsync(void *block, cudaStream_t stream)
{
    remove_block(block);
    return __real_cudaFreeAsync(block, stream);
}
}

namespace
{

enum { STEPS = 24, NUM_TOOLS = 8, FINE_CELLS = 14, RATIO = 4 };
const double edge = 0.14, radius = 0.012, depth = 0.004;

struct Block : Body {
    Block(int n, bool self)
        : Body(std::array<int, 3>{2 * n, 2 * n, 2 * n}.data(), std::array<double, 3>{edge, edge, edge}.data(),
               {{5e3, 0.45, 1000, false}})
    {
        const int ratio = n > FINE_CELLS ? RATIO : 1;
        cells(n / ratio, n / ratio, n / ratio, ratio);
        if (ratio > 1) scene.model.method = PLIANT_AVERAGED;
        fix_plane(0, 0, 1e-3, 0, 0, 1);
        scene.solver.backend = PLIANT_CUDA;
        scene.solver.iterations = 6;
        scene.contact.self = self;
        EXPECT_EQ(build(), PLIANT_OK) << pliant_last_error();
    }
};

struct Memory {
    double allocated = 0, taken = 0, host = 0; // [MiB]
};

Memory now()
{
    const double mebibyte = 1 << 20;
    size_t left = 0, total = 0;
    EXPECT_EQ(cudaDeviceSynchronize(), cudaSuccess);
    EXPECT_EQ(cudaMemGetInfo(&left, &total), cudaSuccess);
    Memory out;
    std::lock_guard<std::mutex> lock(blocks_lock);
    for (const auto &block : blocks) out.allocated += double(block.second) / mebibyte;
    out.taken = double(total - left) / mebibyte;
    out.host = double(pliant_memory_in_use()) / mebibyte;
    return out;
}

Memory between(const Memory &before, const Memory &after, int copies)
{
    return {(after.allocated - before.allocated) / copies, (after.taken - before.taken) / copies,
            (after.host - before.host) / copies};
}

// Press balls into the block. All of them touch it after STEPS.
void press(const Block &block, pliant_data *data, int tools)
{
    for (int t = 0; t < tools; t++) {
        pliant_tool_shape ball{};
        ball.num_parts = 1;
        ball.part[0].kind = PLIANT_PART_SPHERE;
        ball.part[0].radius = radius;
        int tool = -1;
        ASSERT_EQ(pliant_tool_add(block.model, data, ("ball" + std::to_string(t)).c_str(), &tool), PLIANT_OK);
        ASSERT_EQ(pliant_tool_set_shape(data, tool, &ball), PLIANT_OK);
    }
    for (int step = 0; step < STEPS; step++) {
        for (int t = 0; t < tools; t++) {
            const double tip[3] = {0.025 + 0.03 * (t % 4), 0.045 + 0.05 * (t / 4),
                                   edge + radius - depth * step / (STEPS - 1)};
            ASSERT_EQ(pliant_tool_set_pose(data, t, tip, nullptr), PLIANT_OK) << pliant_last_error();
        }
        ASSERT_GE(pliant_step(block.model, data), 0) << pliant_last_error();
    }
}

void print(const char *what, const Memory &memory)
{
    std::printf("%-28s %9.3f MiB allocated, %9.3f MiB taken, %9.3f MiB on the host\n", what, memory.allocated,
                memory.taken, memory.host);
}

// Measure the memory of one simulation, and of one saved state of it.
Memory measure(const char *what, int cells, int copies, int tools, bool self)
{
    Block block(cells, self);
    press(block, block.data, tools); // the first simulation makes what all of them share
    std::vector<pliant_data *> simulations(copies, nullptr);
    std::vector<pliant_state *> states(copies, nullptr);
    const Memory before = now();
    for (pliant_data *&data : simulations) {
        EXPECT_EQ(pliant_data_create(block.model, &data), PLIANT_OK) << pliant_last_error();
        press(block, data, tools);
    }
    const Memory made = now();
    for (int n = 0; n < copies; n++) {
        EXPECT_EQ(pliant_state_create(&states[n]), PLIANT_OK);
        EXPECT_EQ(pliant_state_save(block.model, simulations[n], states[n]), PLIANT_OK) << pliant_last_error();
    }
    const Memory saved = now();
    if (tools == 0 && !self)
        std::printf("%d tetrahedra, %s, mean of %d simulations:\n", block.data->body->fine.num_tets,
                    pliant_data_get_backend(block.data), copies);
    print(what, between(before, made, copies));
    print("  one saved state of it", between(made, saved, copies));
    if (tools > 0) std::printf("  %d contact points\n", block.data->statistics.contacts);
    for (pliant_state *state : states) pliant_state_free(state);
    for (pliant_data *data : simulations) pliant_data_free(data);
    return between(before, made, copies);
}

} // namespace

int main(int argc, char **argv)
{
    const int cells = argc > 1 ? std::atoi(argv[1]) : FINE_CELLS, copies = cells > FINE_CELLS ? 2 : 16;
    const Memory alone = measure("without contact", cells, copies, 0, false),
                 pressed = measure("eight tools in contact", cells, copies, NUM_TOOLS, false),
                 self = measure("self-contact", cells, copies, 0, true);
    print("contact of eight tools adds", between(alone, pressed, 1));
    print("self-contact adds", between(alone, self, 1));
    figure("memory/simulation", alone.allocated, "MiB");
    figure("memory/tools", pressed.allocated - alone.allocated, "MiB");
    figure("memory/self", self.allocated - alone.allocated, "MiB");
    return testing::Test::HasFailure() ? 1 : 0;
}
