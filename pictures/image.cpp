#include "pictures/image.h"

#include <cmath>
#include <filesystem>

#include "base/file.h"
#include "base/names.h"
#include "pictures/image_codecs.h"

namespace splatvol {
namespace {

std::string lower_extension(const std::string& path) {
  return in_lower_case(std::filesystem::path(path).extension().string());
}

/// Like std::max, but NaN counts as the largest.
double max_or_nan(double a, double b) { return std::isnan(b) || b > a ? b : a; }

}  // namespace

bool is_image_path(const std::string& path) {
  const std::string extension = lower_extension(path);
  return extension == ".exr" || extension == ".png";
}

Status write_image(const std::string& path, const Image& image, dvec3 background, const Provenance& provenance,
                   bool transparent) {
  if (!is_image_path(path)) return fail(ErrorCode::invalid_argument, "{}: a picture is an .exr or a .png", path);
  if (image.width < 1 || image.height < 1 ||
      image.pixels.size() != static_cast<std::size_t>(image.width) * image.height)
    return fail(ErrorCode::invalid_argument, "{}: {} x {} with {} pixels is no picture", path, image.width,
                image.height, image.pixels.size());

  // The file is made in memory first: the codecs would hide that a disk is full.
  const bool is_exr = lower_extension(path) == ".exr";
  const Result<std::string> bytes =
      is_exr ? encode_exr(image, provenance) : encode_png(image, background, provenance, transparent);
  if (!bytes) return fail_in(path, bytes.error());
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  SPLATVOL_TRY(file.append(std::as_bytes(std::span(*bytes))));
  return file.commit();
}

Result<Image> read_exr(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(bytes, read_text_file(path));
  auto image = decode_exr(bytes);
  if (!image) return fail_in(path, image.error());
  return image;
}

Result<ImageDifference> compare_images(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.pixels.size() != b.pixels.size())
    return fail(ErrorCode::invalid_argument, "sizes differ: {} x {} and {} x {}", a.width, a.height, b.width, b.height);
  if (a.pixels.empty()) return fail(ErrorCode::invalid_argument, "the pictures are empty");

  ImageDifference difference{};
  double squares = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    for (int channel = 0; channel < 3; ++channel) {
      const double value_a = a.pixels[i][channel];
      const double value_b = b.pixels[i][channel];
      squares += (value_a - value_b) * (value_a - value_b);
      difference.max = max_or_nan(difference.max, std::abs(value_a - value_b));
      difference.mean_a += value_a;
      difference.mean_b += value_b;
    }
  }
  const double count = 3.0 * static_cast<double>(a.pixels.size());
  difference.rmse = std::sqrt(squares / count);
  difference.psnr = -20 * std::log10(difference.rmse);
  difference.mean_a /= count;
  difference.mean_b /= count;
  return difference;
}

}  // namespace splatvol
