#include "ros/output/noise.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace pliant_ros {

namespace {

const size_t MAX_SAMPLES = 200000;
/* Standard deviation of x[i-1] - 2 x[i] + x[i+1] for white noise of standard deviation 1, times the median absolute
 * value of a standard normal variable. */
const double MEDIAN_OF_WHITE_NOISE = std::sqrt(6.0) * 0.6744897501960817;

} // namespace

double noise_of(const pliant_volume &scan)
{
    const int32_t *size = scan.geometry.size;
    if (size[0] < 3) return 0;
    const size_t rows = static_cast<size_t>(size[1]) * static_cast<size_t>(size[2]),
                 inner = static_cast<size_t>(size[0]) - 2;
    const size_t step = std::max<size_t>(rows * inner / MAX_SAMPLES, 1);
    std::vector<float> samples;
    for (size_t n = 0; n < rows * inner; n += step) {
        const size_t at = n / inner * static_cast<size_t>(size[0]) + n % inner + 1;
        const float before = pliant_volume_value(&scan, at - 1), here = pliant_volume_value(&scan, at),
                    after = pliant_volume_value(&scan, at + 1);
        if (before == here && here == after) continue;
        const float difference = std::abs(before - 2 * here + after);
        if (std::isfinite(difference)) samples.push_back(difference);
    }
    if (samples.empty()) return 0;
    const auto middle = samples.begin() + static_cast<std::ptrdiff_t>(samples.size() / 2);
    std::nth_element(samples.begin(), middle, samples.end());
    return *middle / MEDIAN_OF_WHITE_NOISE;
}

} // namespace pliant_ros
