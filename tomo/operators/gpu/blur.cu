// The blur of images by one kernel a view (tomo/operators/image_blur.py): one thread a pixel and column.
//
//     (B y)_p = own_p y_p + sum_k w_k y_(p + k),      (B^T z)_q = own_q z_q + sum_k w_k z_(q - k)
//
// in double precision and in this order. The pixels of a view lie in the cells of a canvas; source is
// the number of the value in each cell, negative where it is dark. A pixel that takes no part has a
// negative cell. Of a pixel and a source in one cell, one of the two factors own is one.

extern "C" __global__ void blurred(
    whole pixels, whole columns, const whole *cell, const whole *view, const double *own,
    const double *own_of_source, const int *source, const whole *kernel, const whole *move,
    const double *weight, const real *values, real *images) {
    whole number = thread_number();
    if (number >= pixels * columns) return;
    whole pixel = number / columns, column = number % columns, at = cell[pixel];
    if (at < 0) return;
    double sum = 0.0;
    if (source[at] >= 0) {
        double factor = own[pixel] * own_of_source[source[at]];
        if (factor != 0.0) sum = factor * (double)values[(whole)source[at] * columns + column];
    }
    for (whole k = kernel[view[pixel]]; k < kernel[view[pixel] + 1]; k++) {
        whole near = source[at + move[k]];
        if (near >= 0) sum += weight[k] * (double)values[near * columns + column];
    }
    images[number] = (real)sum;
}
