// What CUDA has and C++ lacks, so that a host's compiler takes the text of the kernels as it is.
// Threads run one after another, in the order that the caller names: a launch of all of them gives
// the bits that a device must give.
#include <math.h>
#include <string.h>

#include <utility>

#define __global__
#define __device__

struct Numbers {
    unsigned int x;
};
static Numbers blockIdx, threadIdx;
static const Numbers blockDim = {128};

static inline long long __double_as_longlong(double value) {
    long long found;
    memcpy(&found, &value, sizeof found);
    return found;
}

static inline void atomicAdd(unsigned long long *at, unsigned long long value) { *at += value; }

static inline void atomicMax(unsigned long long *at, unsigned long long value) {
    if (value > *at) *at = value;
}

// Call a kernel on threads 0 to threads (excluded), in an order or, without one, ascending.
// arguments point to the values of the kernel's parameters, as for CUDA's own launch.
template <class... Parameters, size_t... number>
static void launch(
    void (*kernel)(Parameters...), std::index_sequence<number...>, long long threads,
    const long long *order, void **arguments) {
    for (long long i = 0; i < threads; i++) {
        long long thread = order ? order[i] : i;
        blockIdx.x = (unsigned int)(thread / blockDim.x);
        threadIdx.x = (unsigned int)(thread % blockDim.x);
        kernel(*static_cast<Parameters *>(arguments[number])...);
    }
}

template <class... Parameters>
static void launch(
    void (*kernel)(Parameters...), long long threads, const long long *order, void **arguments) {
    launch(kernel, std::index_sequence_for<Parameters...>(), threads, order, arguments);
}

// How many parameters a kernel has: the caller's arguments are counted against it.
template <class... Parameters>
static int count(void (*)(Parameters...)) {
    bool all_take_eight_bytes[] = {sizeof(Parameters) == 8 ...};
    for (bool one : all_take_eight_bytes)
        if (!one) return -1;
    return sizeof...(Parameters);
}

#define HOST(name)                                                                             \
    extern "C" void host_##name(long long threads, const long long *order, void **arguments) { \
        launch(name, threads, order, arguments);                                               \
    }                                                                                          \
    extern "C" int count_##name() { return count(name); }
