#include <png.h>

#include <cmath>
#include <csetjmp>
#include <new>
#include <vector>

#include "scene/image_codecs.h"
#include "scene/srgb.h"

namespace splatvol {
namespace {

/// Encodes a linear share of light in 8 bits; NaN gives 0.
png_byte to_srgb8(double linear) {
  return std::isnan(linear) ? png_byte{0} : static_cast<png_byte>(std::lround(srgb_of(linear) * 255));
}

std::vector<png_byte> to_rgb8(const Image& image, dvec3 background) {
  std::vector<png_byte> bytes;
  bytes.reserve(image.pixels.size() * 3);
  for (const vec4& pixel : image.pixels)
    for (int channel = 0; channel < 3; ++channel)
      bytes.push_back(to_srgb8(pixel[channel] + (1.0 - pixel.a) * background[channel]));
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
bool run_encoder(png_structp png, png_infop info, const Image& image, const png_byte* rgb,
                 std::vector<png_text>& texts) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_IHDR(png, info, static_cast<png_uint_32>(image.width), static_cast<png_uint_32>(image.height), 8,
               PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB_gAMA_and_cHRM(png, info, PNG_sRGB_INTENT_RELATIVE);
  png_set_text(png, info, texts.data(), static_cast<int>(texts.size()));
  png_write_info(png, info);
  for (int y = 0; y < image.height; ++y) png_write_row(png, rgb + std::size_t{3} * image.width * y);
  png_write_end(png, info);
  return true;
}

}  // namespace

Result<std::string> encode_png(const Image& image, dvec3 background, const Provenance& provenance) try {
  const std::vector<png_byte> rgb = to_rgb8(image, background);
  std::vector<png_text> texts = text_chunks(provenance);

  PngOutput output;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &output, keep_error, ignore_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  bool done = false;
  if (info) {
    png_set_write_fn(png, &output, append_bytes, flush_nothing);
    done = run_encoder(png, info, image, rgb.data(), texts);
  }
  png_destroy_write_struct(&png, &info);
  if (!done) return fail(ErrorCode::io, "cannot make a PNG file: {}", output.message);
  return std::move(output.bytes);
} catch (const std::exception& error) {
  return fail(ErrorCode::out_of_budget, "cannot make a PNG file: {}", error.what());
}

}  // namespace splatvol
