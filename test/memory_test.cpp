// Tests of the library's memory blocks, and of large blocks that are kept for reuse.
#include "base/buffer.h"
#include "base/memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include <unistd.h>

namespace {

const size_t LARGE = size_t{1} << 20;

struct Keeping {
    int64_t bytes;
    explicit Keeping(int64_t limit) : bytes(limit) { pliant_memory_change_reserve(bytes); }
    ~Keeping() { pliant_memory_change_reserve(-bytes); }
};

bool is(const void *block, int value, size_t bytes)
{
    const auto *at = static_cast<const unsigned char *>(block);
    for (size_t b = 0; b < bytes; b++)
        if (at[b] != value) return false;
    return true;
}

TEST(Memory, FreedBlocksAreReusedCleared)
{
    const size_t before = pliant_memory_in_use();
    Keeping keeping(16 * int64_t(LARGE));
    void *block = pliant_calloc(LARGE, 1);
    ASSERT_NE(block, nullptr);
    std::memset(block, 7, LARGE);
    pliant_free(block);
    EXPECT_EQ(pliant_memory_in_use(), before) << "what is kept is not in use";
    EXPECT_GE(pliant_memory_reserved(), LARGE);
    void *again = pliant_calloc(LARGE, 1);
    EXPECT_EQ(again, block);
    EXPECT_EQ(pliant_memory_reserved(), 0u);
    EXPECT_TRUE(is(again, 0, LARGE));
    EXPECT_EQ(pliant_memory_in_use(), before + LARGE);
    pliant_free(again);
    void *back = pliant_malloc(LARGE, 1);
    EXPECT_EQ(back, block);
    pliant_free(back);
}

// A device locks whole pages of a block, so no other block may lie on these pages.
TEST(Memory, ABlockOfPagesIsAlone)
{
#ifdef PLIANT_SANITIZED
    GTEST_SKIP() << "blocks end where they end, so that what is written behind them is found";
#endif
    const auto page = size_t(sysconf(_SC_PAGESIZE));
    const size_t before = pliant_memory_in_use();
    std::vector<std::pair<uintptr_t, size_t>> alone;
    std::vector<void *> blocks;
    for (size_t bytes : {size_t{1}, page - 64, page, page + 1, 3 * page - 1, LARGE + 1}) {
        blocks.push_back(pliant_calloc(100, 1));
        void *block = pliant_calloc_pages(bytes, 1);
        ASSERT_NE(block, nullptr);
        EXPECT_TRUE(pliant_is_on_own_pages(block));
        EXPECT_TRUE(is(block, 0, bytes));
        std::memset(block, 7, bytes);
        EXPECT_EQ(uintptr_t(block) % page, 0u);
        alone.emplace_back(uintptr_t(block) / page, (bytes + page - 1) / page);
        blocks.push_back(block);
    }
    for (int b = 0; b < 200; b++) blocks.push_back(pliant_calloc(200 + 61 * size_t(b), 1));
    for (void *block : blocks) {
        if (pliant_is_on_own_pages(block)) continue;
        const uintptr_t of = (uintptr_t(block) - 64) / page; // with the header in front of the block
        for (const auto &pages : alone) EXPECT_FALSE(of >= pages.first && of < pages.first + pages.second);
    }
    for (void *block : blocks) pliant_free(block);
    EXPECT_EQ(pliant_memory_in_use(), before);
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_calloc_pages(10, 1), nullptr);
    pliant_memory_fail_after(-1);
}

TEST(Memory, ReservedMemoryHasALimit)
{
    {
        std::vector<void *> blocks;
        Keeping keeping(4 * int64_t(LARGE));
        for (int b = 0; b < 8; b++) blocks.push_back(pliant_calloc(LARGE, 1));
        for (void *block : blocks) pliant_free(block);
        EXPECT_LE(pliant_memory_reserved(), 4 * LARGE);
        EXPECT_GE(pliant_memory_reserved(), 3 * LARGE);
        pliant_free(pliant_calloc(3 * LARGE, 1)); // more than half of the limit
        EXPECT_GE(pliant_memory_reserved(), 3 * LARGE) << "one that is too large takes no other's place";
    }
    EXPECT_EQ(pliant_memory_reserved(), 0u);
    pliant_free(pliant_calloc(LARGE, 1));
    EXPECT_EQ(pliant_memory_reserved(), 0u) << "nothing is, unless somebody says so";
}

TEST(Memory, GrownArraysKeepTheirContentAndAreClearedBehindIt)
{
    Keeping keeping(16 * int64_t(LARGE));
    const size_t before = pliant_memory_in_use();
    auto *block = static_cast<char *>(pliant_malloc(LARGE, 1));
    std::memset(block, 5, LARGE);
    for (size_t bytes : {LARGE + 100, LARGE + 1000, LARGE - 50, 2 * LARGE, LARGE, size_t{100}, size_t{5000}}) {
        block = static_cast<char *>(pliant_resize(block, bytes, 1));
        ASSERT_NE(block, nullptr);
        EXPECT_EQ(pliant_memory_in_use(), before + bytes);
        EXPECT_TRUE(is(block, 5, std::min<size_t>(bytes, 100)));
    }
    EXPECT_TRUE(is(block + 100, 0, 4900));
    std::memset(block, 5, 5000);
    pliant_memory_fail_after(0);
    EXPECT_EQ(pliant_resize(block, LARGE, 1), nullptr);
    EXPECT_TRUE(is(block, 5, 5000)) << "a block that could not grow stays";
    pliant_free(block);
}

// Arrays are derived from one another, as successive bodies do. A new array equals its source, although other arrays
// have been freed or written.
TEST(Memory, ReservesTwiceTheCapacityOrNothing)
{
    int32_t *list = nullptr, capacity = 0;
    for (int32_t n = 0; n < 100; n++) {
        ASSERT_TRUE(pliant_reserve(&list, &capacity, n, 24, sizeof *list));
        EXPECT_EQ(capacity, n < 24 ? 24 : n < 48 ? 48 : n < 96 ? 96 : 192);
        list[n] = n;
    }
    for (int32_t n = 0; n < 100; n++) EXPECT_EQ(list[n], n);
    const int32_t *before = list;
    pliant_memory_fail_after(0);
    EXPECT_FALSE(pliant_reserve(&list, &capacity, 192, 24, sizeof *list));
    pliant_memory_fail_after(-1);
    EXPECT_EQ(list, before);
    EXPECT_EQ(capacity, 192);
    capacity = INT32_MAX / 2 + 1; // twice as many do not fit into a number
    EXPECT_FALSE(pliant_reserve(&list, &capacity, capacity, 24, sizeof *list));
    EXPECT_EQ(list, before);
    pliant_free(list);
}

TEST(Memory, ANewVersionIsIdenticalToItsArray)
{
    Keeping keeping(64 * int64_t(LARGE));
    const size_t before = pliant_memory_in_use();
    std::mt19937 random(3);
    struct Array { int *block; std::vector<int> wanted; };
    std::vector<Array> arrays;
    const size_t first = 40000;
    auto *at_load = static_cast<int *>(pliant_calloc(first, sizeof(int)));
    for (size_t n = 0; n < first; n++) at_load[n] = int(random());
    arrays.push_back({at_load, std::vector<int>(at_load, at_load + first)});
    for (int round = 0; round < 300; round++) {
        const size_t of = random() % arrays.size(), count = arrays[of].wanted.size(),
                     kept = random() % 4 ? count : count - random() % 3000, more = random() % 3 ? 0 : random() % 2000;
        Array next{static_cast<int *>(pliant_next_version(arrays[of].block, kept, kept + more, sizeof(int))),
                   arrays[of].wanted};
        ASSERT_NE(next.block, nullptr);
        next.wanted.resize(kept);
        next.wanted.resize(kept + more, 0);
        for (int w = 0; w < 5; w++) {
            const size_t place = random() % next.wanted.size(),
                         run = std::min<size_t>(random() % 40, next.wanted.size() - place);
            for (size_t n = place; n < place + run; n++) next.block[n] = next.wanted[n] = int(random());
            pliant_mark_written(next.block, place, run, sizeof(int));
        }
        if (round % 5 == 0) { /* new entries may be written without a report, and removed entries are gone */
            const size_t was = next.wanted.size(), is = round % 10 ? was + random() % 1500 : was - random() % 1500;
            next.block = static_cast<int *>(pliant_resize(next.block, is, sizeof(int)));
            ASSERT_NE(next.block, nullptr);
            next.wanted.resize(is, 0);
            for (size_t n = was; n < is; n++) next.block[n] = next.wanted[n] = int(random());
        }
        ASSERT_EQ(std::memcmp(next.block, next.wanted.data(), next.wanted.size() * sizeof(int)), 0) << round;
        const size_t common = std::min(next.wanted.size(), count) * sizeof(int);
        size_t from = 0, to = 0, same_up_to = 0;
        while (pliant_next_difference(next.block, arrays[of].block, common, &from, &to)) {
            ASSERT_EQ(std::memcmp(reinterpret_cast<char *>(next.block) + same_up_to,
                                  reinterpret_cast<char *>(arrays[of].block) + same_up_to, from - same_up_to),
                      0);
            ASSERT_LT(from, to);
            same_up_to = to;
        }
        ASSERT_EQ(std::memcmp(reinterpret_cast<char *>(next.block) + same_up_to,
                              reinterpret_cast<char *>(arrays[of].block) + same_up_to, common - same_up_to),
                  0);
        arrays.push_back(next);
        while (arrays.size() > 4) {
            const size_t goes = 1 + random() % (arrays.size() - 1);
            pliant_free(arrays[goes].block);
            arrays.erase(arrays.begin() + long(goes));
        }
    }
    for (const Array &array : arrays) pliant_free(array.block);
    EXPECT_EQ(pliant_memory_in_use(), before);
}

// Unreported writes are not detected. An array without a source is still compared piece by piece, once another one is
// derived from it.
TEST(Memory, UnchangedPartsAreNotReadAgain)
{
    Keeping keeping(64 * int64_t(LARGE));
    auto *at_load = static_cast<char *>(pliant_calloc(LARGE, 1));
    auto *next = static_cast<char *>(pliant_next_version(at_load, LARGE, LARGE, 1));
    ASSERT_NE(next, nullptr);
    size_t from = 0, to = 0;
    next[100] = 1;
    EXPECT_FALSE(pliant_next_difference(next, at_load, LARGE, &from, &to));
    pliant_mark_written(next, 100, 1, 1);
    ASSERT_TRUE(pliant_next_difference(next, at_load, LARGE, &from, &to));
    EXPECT_LE(from, 100u);
    EXPECT_GT(to, 100u);
    EXPECT_LT(to, LARGE / 2);
    next[LARGE - 1] = 1;
    pliant_free(next);
    /* it reuses the memory: reported writes are reset to the source */
    next = static_cast<char *>(pliant_next_version(at_load, LARGE, LARGE, 1));
    ASSERT_NE(next, nullptr);
    EXPECT_EQ(next[100], 0);
    EXPECT_EQ(next[LARGE - 1], 1);
    pliant_free(next);
    pliant_free(at_load);
}

TEST(Memory, ABlockIsFreedByItsLastOwner)
{
    const size_t before = pliant_memory_in_use();
    for (const size_t bytes : {size_t{24}, LARGE}) {
        Keeping keeping(16 * int64_t(LARGE));
        void *block = pliant_calloc(bytes, 1);
        ASSERT_NE(block, nullptr);
        const size_t one = pliant_memory_in_use();
        EXPECT_EQ(pliant_retain_block(block), block);
        EXPECT_EQ(pliant_memory_in_use(), one) << "it is there once";
        std::vector<std::thread> holders;
        for (int h = 0; h < 4; h++) {
            pliant_retain_block(block);
            holders.emplace_back([block] {
                for (int i = 0; i < 10000; i++) pliant_free(pliant_retain_block(block));
                pliant_free(block);
            });
        }
        for (auto &holder : holders) holder.join();
        std::memset(block, 7, bytes);
        pliant_free(block);
        EXPECT_EQ(pliant_memory_in_use(), one);
        EXPECT_TRUE(is(block, 7, bytes)) << "it is its other holder's";
        pliant_free(block);
        EXPECT_EQ(pliant_memory_in_use(), before);
        void *again = pliant_calloc(bytes, 1);
        pliant_free(again);
        EXPECT_EQ(pliant_memory_in_use(), before) << "whoever has it next is alone";
    }
    EXPECT_EQ(pliant_retain_block(nullptr), nullptr);
}

TEST(Memory, CopiesAreCompleteAndEmptyBlocksAreValid)
{
    const double values[3] = {1, 2, 3};
    auto *copy = static_cast<double *>(pliant_copy_block(values, 3, sizeof *values));
    EXPECT_EQ(std::memcmp(copy, values, sizeof values), 0);
    auto *one = static_cast<double *>(pliant_copy_block(nullptr, 0, sizeof *values));
    ASSERT_NE(one, nullptr);
    EXPECT_EQ(*one, 0);
    pliant_free(copy);
    pliant_free(one);
}

} // namespace
