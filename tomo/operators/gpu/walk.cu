// The exact walk of a ray through the voxels of a grid.
//
// A ray is  p(t) = p0 + d t,  0 <= t <= end:  p in voxels from the grid's lower corner, t the world
// length from where the ray enters the box. Along one axis it passes its k-th plane between voxels at
//
//     t(k) = (offset + k) / |d|,    k = 0, 1, ..., last - 1,
//
// where offset is the way to the first plane, above 0 and at most 1. Times follow from k and are
// never added up. The pieces between one plane and the next, of all three axes, are the ray's
// lengths in voxels. The steps are those of tomo/trace/plane_crossings.py, whose conventions hold: a
// ray in a face belongs to the voxel above it, and the grid's upper outer face to the last voxel.
//
// The text is CUDA C++ and, with the functions that a compiler for the host lacks, C++. It has to be
// compiled without contraction of a * b + c: device and host then give the same bits.

typedef long long whole;
typedef unsigned long long bits;

#define NEVER 1e300   // later than any ray ends
#define STILL 1e-300  // voxels per length below which a ray is parallel: as in tomo/rays/ray_box.py

// Lower and upper corner of the box, edges of a voxel, and voxels along x, y, z. The planes along x
// that are walked are first to stop (excluded): all, or a slab of them.
struct Grid {
    double lower[3], upper[3], spacing[3], shape[3], first, stop;
};

// A straight piece of a line of sight in the world: direction is a unit vector, length may be
// infinite, weight is the piece's share of its pixel.
struct Ray {
    double origin[3], direction[3], length, weight;
};

// One axis of a ray: the planes passed and those ahead inside the box; the time of the next.
struct Axis {
    double offset, per_plane, passed, last, next;
    whole stride;  // from one voxel to the next that the ray enters
};

__device__ inline double lesser(double a, double b) { return a < b ? a : b; }
__device__ inline double greater(double a, double b) { return a > b ? a : b; }

// A coordinate in voxels: what lies on the upper outer face is there however the division rounds.
__device__ inline double in_voxels(double point, const Grid &grid, int axis) {
    double position = (point - grid.lower[axis]) / grid.spacing[axis];
    return point <= grid.upper[axis] ? lesser(position, grid.shape[axis]) : position;
}

// Clip start <= t <= stop to the slab 0 <= position + direction t <= count.
__device__ inline void clip(
    double position, double direction, double count, double &start, double &stop) {
    if (fabs(direction) < STILL) {
        if (position < 0.0 || position > count) stop = -1.0;
        return;
    }
    double lower = (0.0 - position) / direction, upper = (count - position) / direction;
    start = greater(start, lesser(lower, upper));
    stop = lesser(stop, greater(lower, upper));
}

// The planes of one axis for a ray that enters the box at position, and the voxel that it moves into.
__device__ inline Axis planes_ahead(
    double position, double direction, bool still, double count, whole stride, whole &voxel) {
    bool back = direction < 0.0 && !still;
    double first = back ? ceil(position) - 1.0 : floor(position);
    first = lesser(greater(first, 0.0), count - 1.0);
    voxel += (whole)first * stride;
    Axis axis;
    axis.offset = back ? position - first : first + 1.0 - position;
    axis.per_plane = still ? NEVER : 1.0 / fabs(direction);
    axis.passed = 0.0;
    axis.last = still ? 0.0 : back ? first : count - 1.0 - first;  // the outer face is the end
    axis.next = axis.last > 0.0 ? axis.offset * axis.per_plane : NEVER;
    axis.stride = back ? -stride : stride;
    return axis;
}

__device__ inline void pass(Axis &axis, whole &voxel) {
    voxel += axis.stride;
    axis.passed += 1.0;
    axis.next = axis.passed < axis.last ? (axis.offset + axis.passed) * axis.per_plane : NEVER;
}

// Move a ray from its entry into the grid to that into the slab; position is then that in the slab.
// Returns the length in it, of the length in the grid. A ray in a face belongs to the slab above.
__device__ inline double enter_slab(
    double *position, const double *direction, bool still, const Grid &grid, double end) {
    double start = 0.0, count = grid.stop - grid.first;
    position[0] -= grid.first;
    if (still) {
        bool is_below = position[0] < count || (position[0] == count && grid.stop == grid.shape[0]);
        return position[0] >= 0.0 && is_below ? end : 0.0;
    }
    clip(position[0], direction[0], count, start, end);
    for (int axis = 0; axis < 3; axis++) position[axis] += direction[axis] * start;
    return end - start;
}

// Call visit(voxel, time, length) for the pieces of a ray in the voxels of a grid, in their order:
// the flat number of the voxel, when the ray enters it, and the length in it, above zero. Returns the
// length in the box, zero for a ray that misses it or is not a number.
template <class Visit>
__device__ inline double walk(const Ray &ray, const Grid &grid, Visit visit) {
    double position[3], direction[3], start = 0.0, stop = ray.length, sum = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        position[axis] = in_voxels(ray.origin[axis], grid, axis);
        direction[axis] = ray.direction[axis] / grid.spacing[axis];
        clip(position[axis], direction[axis], grid.shape[axis], start, stop);
        sum += position[axis] + direction[axis];
    }
    double end = stop - start;
    if (!(end > 0.0) || sum != sum) return 0.0;
    bool still[3];  // gets nowhere along an axis
    for (int axis = 0; axis < 3; axis++) {
        position[axis] += direction[axis] * start;
        still[axis] = direction[axis] == 0.0 ||
                      position[axis] + direction[axis] * end == position[axis];
    }
    double count = grid.stop - grid.first;
    if (count != grid.shape[0]) {
        end = enter_slab(position, direction, still[0], grid, end);
        if (!(end > 0.0)) return 0.0;
    }
    whole column = (whole)grid.shape[2], plane = (whole)grid.shape[1] * column, voxel = 0;
    Axis x = planes_ahead(position[0], direction[0], still[0], count, plane, voxel);
    Axis y = planes_ahead(position[1], direction[1], still[1], grid.shape[1], column, voxel);
    Axis z = planes_ahead(position[2], direction[2], still[2], grid.shape[2], 1, voxel);
    double now = 0.0;
    for (;;) {
        double next = lesser(lesser(x.next, y.next), lesser(z.next, end));
        if (next > now) {
            visit(voxel, now, next - now);
            now = next;
        }
        if (!(next < end)) return end;
        // Planes that meet in an edge are passed one after the other: pieces of no length between.
        if (x.next == next) pass(x, voxel);
        else if (y.next == next) pass(y, voxel);
        else pass(z, voxel);
    }
}
