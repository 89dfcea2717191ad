// Pictures that wider samples would have given, without drawing them.
#pragma once

#include "pictures/image.h"

namespace splatvol {

/// Returns the picture that CellRasterizer draws with samples `spacing` pixels apart, made from its picture with a
/// sample in each pixel. Each spacing-th pixel is a sample, and the same cubics join them. So the difference from
/// `exact` tells the error of wider samples.
///
/// Where the places of samples are pixels' centres, only rounding differs. Otherwise the pixels half a pixel to the
/// left or above stand for them: that is so on an axis of an even number of pixels if the spacing is even. Samples
/// beyond the picture's ends go on as the two before them.
///
/// `refined_difference`: as CellDrawing's. Requires spacing >= 1. `memory`: an image that is needed no more, whose
/// memory the picture takes. Runs on all threads.
[[nodiscard]] Image with_wide_samples(const Image& exact, int spacing, float refined_difference = 0, Image memory = {});

}  // namespace splatvol
