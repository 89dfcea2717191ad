#include <png.h>

#include <array>
#include <cmath>
#include <csetjmp>
#include <cstddef>
#include <limits>
#include <new>
#include <vector>

#include "pictures/image_codecs.h"
#include "scene/srgb.h"

namespace splatvol {
namespace {

/// Encodes linear shares of light in 8 bits, as srgb_of and rounding do, without their powers.
class SrgbBytes {
 public:
  SrgbBytes() {
    for (int byte = 1; byte < 256; ++byte) {
      double least = linear_of((byte - 0.5) / 255);  // the least number with this byte, but for rounding
      while (encode(least) >= byte) least = std::nextafter(least, 0.0);
      while (encode(least) < byte) least = std::nextafter(least, 1.0);
      least_[static_cast<std::size_t>(byte)] = least;
    }
    least_[256] = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < starts; ++k) start_[k] = encode(static_cast<double>(k) / starts);
  }

  /// NaN gives 0.
  [[nodiscard]] png_byte operator()(double linear) const {
    if (!(linear > 0)) return 0;
    if (linear >= 1) return 255;
    std::size_t byte = start_[static_cast<std::size_t>(linear * starts)];
    while (linear >= least_[byte + 1]) ++byte;
    return static_cast<png_byte>(byte);
  }

 private:
  static constexpr std::size_t starts = 4096;  // less than a byte from one to the next

  static png_byte encode(double linear) { return static_cast<png_byte>(std::lround(srgb_of(linear) * 255)); }

  std::array<double, 257> least_{};
  std::array<png_byte, starts> start_{};
};

std::vector<png_byte> to_rgb8(const Image& image, dvec3 background) {
  static const SrgbBytes to_srgb8;
  std::vector<png_byte> bytes(image.pixels.size() * 3);
  std::size_t next = 0;
  for (const vec4& pixel : image.pixels)
    for (int channel = 0; channel < 3; ++channel)
      bytes[next++] = to_srgb8(pixel[channel] + (1.0 - pixel.a) * background[channel]);
  return bytes;
}

// Programs blend encoded numbers and not light. Chooses an encoded colour c and an alpha a so that over the encoded
// background b they give the right number r: a c + (1 - a) b = r. The alpha is that of the light, or the least with
// which c is a colour.
std::vector<png_byte> to_rgba8(const Image& image, dvec3 background) {
  std::vector<png_byte> bytes;
  bytes.reserve(image.pixels.size() * 4);
  for (const vec4& pixel : image.pixels) {
    dvec3 wanted, behind;
    double alpha = std::isnan(pixel.a) ? 0 : std::clamp(static_cast<double>(pixel.a), 0.0, 1.0);
    for (int channel = 0; channel < 3; ++channel) {
      const double linear = pixel[channel] + (1.0 - pixel.a) * background[channel];
      const double r = wanted[channel] = std::isnan(linear) ? 0 : srgb_of(linear);
      const double b = behind[channel] = srgb_of(background[channel]);
      if (r > b) alpha = std::max(alpha, (r - b) / (1 - b));
      if (r < b) alpha = std::max(alpha, (b - r) / b);
    }
    for (int channel = 0; channel < 3; ++channel) {
      const double c = alpha > 0 ? (wanted[channel] - (1 - alpha) * behind[channel]) / alpha : 0;
      bytes.push_back(static_cast<png_byte>(std::lround(255 * std::clamp(c, 0.0, 1.0))));
    }
    bytes.push_back(static_cast<png_byte>(std::lround(255 * alpha)));
  }
  return bytes;
}

std::vector<png_text> text_chunks(const Provenance& provenance) {
  std::vector<png_text> chunks;
  for (const auto& [name, value] : provenance) {
    png_text chunk{};
    chunk.compression = PNG_ITXT_COMPRESSION_NONE;
    chunk.key = const_cast<char*>(name.c_str());
    chunk.text = const_cast<char*>(value.c_str());
    chunk.itxt_length = value.size();
    chunks.push_back(chunk);
  }
  return chunks;
}

/// The result of the encoder: the file, or the reason why there is none.
struct PngOutput {
  std::string bytes;
  char message[128] = "";
};

[[noreturn]] void keep_error(png_structp png, png_const_charp message) {
  auto* output = static_cast<PngOutput*>(png_get_error_ptr(png));
  std::snprintf(output->message, sizeof output->message, "%s", message);
  png_longjmp(png, 1);
}

void ignore_warning(png_structp, png_const_charp) {}

void append_bytes(png_structp png, png_bytep data, std::size_t count) {
  auto* output = static_cast<PngOutput*>(png_get_io_ptr(png));
  bool enough_memory = true;
  try {
    output->bytes.append(reinterpret_cast<const char*>(data), count);
  } catch (const std::bad_alloc&) {
    enough_memory = false;
  }
  if (!enough_memory) png_error(png, "not enough memory");
}

void flush_nothing(png_structp) {}

/// Runs the encoder; false after an error. libpng leaves this function by longjmp, so no local object has a destructor.
bool run_encoder(png_structp png, png_infop info, const Image& image, const png_byte* bytes, int channels,
                 std::vector<png_text>& texts) {
  constexpr int compression_level = 4;  // a third of the usual time, for 7 % more bytes
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_compression_level(png, compression_level);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_PAETH);
  png_set_IHDR(png, info, static_cast<png_uint_32>(image.width), static_cast<png_uint_32>(image.height), 8,
               channels == 4 ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
  png_set_text(png, info, texts.data(), static_cast<int>(texts.size()));
  png_write_info(png, info);
  for (int y = 0; y < image.height; ++y)
    png_write_row(png, bytes + static_cast<std::size_t>(channels) * static_cast<std::size_t>(image.width) * y);
  png_write_end(png, info);
  return true;
}

}  // namespace

Result<std::string> encode_png(const Image& image, dvec3 background, const Provenance& provenance,
                               bool transparent) try {
  const std::vector<png_byte> bytes = transparent ? to_rgba8(image, background) : to_rgb8(image, background);
  std::vector<png_text> texts = text_chunks(provenance);

  PngOutput output;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &output, keep_error, ignore_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  bool done = false;
  if (info) {
    png_set_write_fn(png, &output, append_bytes, flush_nothing);
    done = run_encoder(png, info, image, bytes.data(), transparent ? 4 : 3, texts);
  }
  png_destroy_write_struct(&png, &info);
  if (!done) return fail(ErrorCode::io, "cannot make a PNG file: {}", output.message);
  return std::move(output.bytes);
} catch (const std::exception& error) {
  return fail(ErrorCode::out_of_budget, "cannot make a PNG file: {}", error.what());
}

}  // namespace splatvol
