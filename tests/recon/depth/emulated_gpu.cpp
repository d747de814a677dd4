// Runs CUDA kernels on the processor, one warp after another: its threads are contexts that wait for each other at
// shuffles. Included before the kernels; `run_KERNEL` calls one.

#include <setjmp.h>
#include <ucontext.h>

#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <tuple>
#include <utility>
#include <vector>

#define __global__
#define __device__
#define __shared__ static

using std::abs;
using std::max;
using std::min;

struct Index {
    int x, y;
};

constexpr int WARP = 32, STACK = 1 << 16;
static Index threadIdx, blockIdx, blockDim;
static int current;
static ucontext_t scheduler, contexts[WARP];
static jmp_buf back, places[WARP];  // switching by these needs no call of the system
static bool begun[WARP], ended[WARP];
static std::vector<char> stacks(size_t(WARP) * STACK);
static std::function<void()> body;
static int exchanged[2][WARP], arrivals[WARP];

static void wait() {
    if (!_setjmp(places[current])) _longjmp(back, 1);
}

static void thread() {
    body();
    ended[current] = true;
    _longjmp(back, 1);
}

__attribute__((noinline)) static void resume() {
    if (_setjmp(back)) return;
    if (begun[current]) _longjmp(places[current], 1);
    begun[current] = true;
    swapcontext(&scheduler, &contexts[current]);
}

static int exchange(unsigned members, int word, int source) {
    const int round = arrivals[current]++;
    exchanged[round & 1][current] = word;
    if (!(members >> current & 1) || !(members >> source & 1) || ended[source]) std::abort();
    for (bool all = false; !all;) {
        all = true;
        for (int other = 0; other < WARP; ++other)
            all = all && (!(members >> other & 1) || arrivals[other] > round);
        if (!all) wait();
    }
    return exchanged[round & 1][source];
}

template <class T>
static T __shfl_sync(unsigned members, T number, int source, int width) {
    int word;
    std::memcpy(&word, &number, sizeof word);
    word = exchange(members, word, current / width * width + (source & (width - 1)));
    std::memcpy(&number, &word, sizeof word);
    return number;
}

template <class T>
static T __shfl_xor_sync(unsigned members, T number, int distance, int width) {
    return __shfl_sync(members, number, current % width ^ distance, width);
}

static int __popc(unsigned word) { return __builtin_popcount(word); }
static float __fmaf_rn(float first, float second, float third) { return std::fmaf(first, second, third); }
static int __float_as_int(float number) {
    int word;
    std::memcpy(&word, &number, sizeof word);
    return word;
}
static float __int_as_float(int word) {
    float number;
    std::memcpy(&number, &word, sizeof word);
    return number;
}

static void run_blocks(const int* grid, int threads) {
    blockDim = {threads, 1};
    for (blockIdx.y = 0; blockIdx.y < grid[1]; ++blockIdx.y)
        for (blockIdx.x = 0; blockIdx.x < grid[0]; ++blockIdx.x)
            for (int first = 0; first < threads; first += WARP) {
                for (current = 0; current < WARP; ++current) {
                    begun[current] = ended[current] = false;
                    arrivals[current] = 0;
                    getcontext(&contexts[current]);
                    contexts[current].uc_stack.ss_sp = &stacks[size_t(current) * STACK];
                    contexts[current].uc_stack.ss_size = STACK;
                    contexts[current].uc_link = nullptr;
                    makecontext(&contexts[current], thread, 0);
                }
                for (bool all = false; !all;) {
                    all = true;
                    for (current = 0; current < WARP; ++current) {
                        if (ended[current]) continue;
                        threadIdx = {first + current, 0};
                        resume();
                        all = all && ended[current];
                    }
                }
            }
}

template <class... Parameters, size_t... places>
static void run(void (*kernel)(Parameters...), const int* grid, int threads, void** arguments,
                std::index_sequence<places...>) {
    body = [=] { kernel(*static_cast<Parameters*>(arguments[places])...); };
    run_blocks(grid, threads);
}

template <class... Parameters>
static void run(void (*kernel)(Parameters...), const int* grid, int threads, void** arguments) {
    run(kernel, grid, threads, arguments, std::index_sequence_for<Parameters...>());
}

#define RUN(kernel) \
    extern "C" void run_##kernel(const int* grid, int threads, void** arguments) { run(kernel, grid, threads, arguments); }
