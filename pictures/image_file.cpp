#include <filesystem>

#include "base/file.h"
#include "base/names.h"
#include "pictures/image.h"
#include "pictures/image_codecs.h"

namespace splatvol {
namespace {

std::string lower_extension(const std::string& path) {
  return in_lower_case(std::filesystem::path(path).extension().string());
}

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

}  // namespace splatvol
