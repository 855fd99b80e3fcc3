// Products with the matrix of lengths, computed at every product: one thread a pixel.
//
// Pixel p owns the rays starts[p] to stops[p] (excluded). With the length l of a ray in a voxel, its
// weight w and the fraction f of the light that arrives,
//
//     forward    b_p = sum over its rays and their voxels of  w l f x_v,   in double precision;
//     adjoint    z_v = sum over pixels of  round(w l f y_p u) / u,          in whole numbers.
//
// The adjoint adds 64-bit whole numbers by atomics. Sums of whole numbers do not depend on their
// order, so every run and every schedule of threads gives the same bits. u is a power of two with
// |z_v| u < 2^62 for all voxels; the largest sum cannot overflow, and n pieces in a voxel are off by
// at most n / (2 u), n 2^-62 of the largest possible sum.

#define LANES 8  // neighbours that add up one row: their entries fill a sector of memory, 32 bytes

__device__ inline whole thread_number() {
    return (whole)blockIdx.x * (whole)blockDim.x + (whole)threadIdx.x;
}

// e^x for x <= 0, of plain sums and products: those of libraries differ in the last bit.
// e^x = 2^n e^r with |r| <= ln(2) / 2; the first term left out is below 2^-57.
__device__ inline double exponential(double x) {
    if (!(x >= -700.0)) return x < 0.0 ? 0.0 : x;  // NaN stays
    double n = rint(x * 1.4426950408889634);
    double r = (x - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    double sum = 1.0;
    for (int k = 13; k > 0; k--) sum = 1.0 + sum * r * (1.0 / k);
    return ldexp(sum, (int)n);
}

// Gas that lets all light through.
struct Clear {
    __device__ void begin(whole) {}
    __device__ double arriving(whole, double, double) { return 1.0; }
    __device__ void end(whole, double) {}
};

// Beer and Lambert's law along a path, from the camera on (tomo/operators/attenuation.py):
//     f = exp(-medium t - sum of extinction l before - extinction l / 2),   t to the piece's middle.
struct Gas {
    double medium;
    const double *extinction;      // (voxels,) in 1 / length
    const double *outside;         // (rays, 2) depth of each ray before and after the grid, or null
    const unsigned char *is_first; // (rays,) whether a ray begins a path of light
    double depth;
    __device__ void begin(whole ray) {
        if (is_first[ray]) depth = 0.0;
        if (outside) depth += outside[2 * ray];
    }
    __device__ double arriving(whole voxel, double time, double length) {
        double own = extinction[voxel] * length;
        double before = depth + medium * (time + length / 2.0);
        depth += own;
        return exponential(-(before + own / 2.0));
    }
    __device__ void end(whole ray, double length) {
        depth += medium * length;
        if (outside) depth += outside[2 * ray + 1];
    }
};

// Call visit(voxel, w l f) for all pieces of a pixel's rays.
template <class Light, class Visit>
__device__ inline void see(
    whole start, whole stop, const Ray *rays, const Grid *grid, Light light, Visit visit) {
    for (whole ray = start; ray < stop; ray++) {
        double weight = rays[ray].weight;
        light.begin(ray);
        double inside = walk(rays[ray], *grid, [&](whole voxel, double time, double length) {
            visit(voxel, weight * length * light.arriving(voxel, time, length));
        });
        light.end(ray, inside);
    }
}

// b_p of the columns first to first + COLUMNS (excluded) of a volume (voxels, columns).
template <int COLUMNS, class Light>
__device__ inline void forward(
    whole pixels, const whole *starts, const whole *stops, const Ray *rays, const Grid *grid,
    const real *volume, real *images, whole columns, whole first, Light light) {
    whole pixel = thread_number();
    if (pixel >= pixels) return;
    double sums[COLUMNS] = {};
    see(starts[pixel], stops[pixel], rays, grid, light, [&](whole voxel, double length) {
        for (int c = 0; c < COLUMNS; c++)
            sums[c] += length * (double)volume[voxel * columns + first + c];
    });
    for (int c = 0; c < COLUMNS; c++) images[pixel * columns + first + c] = (real)sums[c];
}

// z_v u of the same columns, added to sums (voxels, COLUMNS); voxels that are not active get none.
template <int COLUMNS, class Light>
__device__ inline void adjoint(
    whole pixels, const whole *starts, const whole *stops, const Ray *rays, const Grid *grid,
    const unsigned char *active, const real *images, const double *per_unit, bits *sums,
    whole columns, whole first, Light light) {
    whole pixel = thread_number();
    if (pixel >= pixels) return;
    double values[COLUMNS];
    bool dark = true;
    for (int c = 0; c < COLUMNS; c++) {
        values[c] = (double)images[pixel * columns + first + c] * per_unit[first + c];
        dark = dark && values[c] == 0.0;
    }
    if (dark) return;
    see(starts[pixel], stops[pixel], rays, grid, light, [&](whole voxel, double length) {
        if (active && !active[voxel]) return;
        for (int c = 0; c < COLUMNS; c++)
            atomicAdd(sums + voxel * COLUMNS + c, (bits)(whole)rint(length * values[c]));
    });
}

#define RAYS                                                                                      \
    whole pixels, const whole *starts, const whole *stops, const Ray *rays, const Grid *grid
#define GAS double medium, const double *extinction, const double *outside, const unsigned char *is_first
#define FORWARD_OF const real *volume, real *images, whole columns, whole first
#define ADJOINT_OF                                                                                \
    const unsigned char *active, const real *images, const double *per_unit, bits *sums,          \
        whole columns, whole first

extern "C" {

__global__ void forward_1(RAYS, FORWARD_OF) {
    forward<1>(pixels, starts, stops, rays, grid, volume, images, columns, first, Clear());
}

__global__ void forward_4(RAYS, FORWARD_OF) {
    forward<4>(pixels, starts, stops, rays, grid, volume, images, columns, first, Clear());
}

__global__ void dimmed_forward(RAYS, FORWARD_OF, GAS) {
    Gas gas = {medium, extinction, outside, is_first, 0.0};
    forward<1>(pixels, starts, stops, rays, grid, volume, images, columns, first, gas);
}

__global__ void adjoint_1(RAYS, ADJOINT_OF) {
    adjoint<1>(
        pixels, starts, stops, rays, grid, active, images, per_unit, sums, columns, first, Clear());
}

__global__ void adjoint_4(RAYS, ADJOINT_OF) {
    adjoint<4>(
        pixels, starts, stops, rays, grid, active, images, per_unit, sums, columns, first, Clear());
}

__global__ void dimmed_adjoint(RAYS, ADJOINT_OF, GAS) {
    Gas gas = {medium, extinction, outside, is_first, 0.0};
    adjoint<1>(
        pixels, starts, stops, rays, grid, active, images, per_unit, sums, columns, first, gas);
}

// The largest magnitude of each column of values (rows, columns), as the bits of a double: those of
// magnitudes ascend as whole numbers do, NaN last. Each thread takes every strands-th row.
__global__ void largest(whole rows, whole columns, whole strands, const real *values, bits *found) {
    whole column = thread_number() % columns, strand = thread_number() / columns;
    if (strand >= strands) return;
    bits most = 0;
    for (whole row = strand; row < rows; row += strands) {
        bits one = (bits)__double_as_longlong(fabs((double)values[row * columns + column]));
        most = one > most ? one : most;
    }
    atomicMax(found + column, most);
}

// Unknowns (unknowns, columns) to the voxels that they are the numbers of; others stay zero.
__global__ void spread(
    whole unknowns, whole columns, const whole *index, const real *values, real *volume) {
    whole number = thread_number();
    if (number >= unknowns * columns) return;
    volume[index[number / columns] * columns + number % columns] = values[number];
}

// Sums of whole numbers (voxels, some) to the columns first to first + some of the unknowns.
__global__ void collect(
    whole unknowns, whole some, const whole *index, const bits *sums, const double *per_unit,
    real *values, whole columns, whole first) {
    whole number = thread_number();
    if (number >= unknowns * some) return;
    whole unknown = number / some, column = number % some;
    whole voxel = index ? index[unknown] : unknown;
    values[unknown * columns + first + column] =
        (real)((double)(whole)sums[voxel * some + column] / per_unit[first + column]);
}

}  // extern "C"

// Products with stored rows: row p owns the entries starts[p] to stops[p] of column and entry.
//     b_p = sum over entries s of  entry_s x_(column_s),
// added up by LANES threads, each every LANES-th entry, in double precision. The transposed matrix
// is stored the same way. Entries are in single or in double precision, the other pointer is null.
template <int COLUMNS>
__device__ inline void row_parts(
    whole rows, const whole *starts, const whole *stops, const unsigned int *column,
    const float *single_entry, const double *double_entry, const real *x, whole columns,
    whole first, double *parts) {
    whole row = thread_number() / LANES, lane = thread_number() % LANES;
    if (row >= rows) return;
    double sums[COLUMNS] = {};
    for (whole s = starts[row] + lane; s < stops[row]; s += LANES) {
        double entry = single_entry ? (double)single_entry[s] : double_entry[s];
        for (int c = 0; c < COLUMNS; c++)
            sums[c] += entry * (double)x[(whole)column[s] * columns + first + c];
    }
    for (int c = 0; c < COLUMNS; c++) parts[thread_number() * COLUMNS + c] = sums[c];
}

#define ROWS                                                                                      \
    whole rows, const whole *starts, const whole *stops, const unsigned int *column,              \
        const float *single_entry, const double *double_entry, const real *x, whole columns,      \
        whole first, double *parts

extern "C" {

__global__ void row_parts_1(ROWS) {
    row_parts<1>(rows, starts, stops, column, single_entry, double_entry, x, columns, first, parts);
}

__global__ void row_parts_4(ROWS) {
    row_parts<4>(rows, starts, stops, column, single_entry, double_entry, x, columns, first, parts);
}

// The sums of each row's parts (rows, LANES, some), in the order of the lanes.
__global__ void row_totals(
    whole rows, whole some, const double *parts, real *values, whole columns, whole first) {
    whole number = thread_number();
    if (number >= rows * some) return;
    whole row = number / some, column = number % some;
    double sum = 0.0;
    for (int lane = 0; lane < LANES; lane++) sum += parts[(row * LANES + lane) * some + column];
    values[row * columns + first + column] = (real)sum;
}

}  // extern "C"
