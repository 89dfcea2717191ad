#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>

#include <algorithm>
#include <cstring>
#include <exception>

#include "pictures/image_codecs.h"

namespace splatvol {
namespace {

constexpr const char* channel_names[] = {"R", "G", "B", "A"};
constexpr int largest_side = 16384;

/// Bytes in memory for OpenEXR's reader, without a copy.
class MemoryStream final : public Imf::IStream {
 public:
  explicit MemoryStream(const std::string& bytes) : Imf::IStream("EXR"), bytes_(bytes) {}

  bool read(char out[], int count) override {
    if (count < 0 || static_cast<std::uint64_t>(count) > bytes_.size() - position_)
      throw std::runtime_error("the file ends too early");
    std::memcpy(out, bytes_.data() + position_, static_cast<std::size_t>(count));
    position_ += static_cast<std::uint64_t>(count);
    return position_ < bytes_.size();
  }
  std::uint64_t tellg() override { return position_; }
  void seekg(std::uint64_t position) override { position_ = std::min<std::uint64_t>(position, bytes_.size()); }

 private:
  const std::string& bytes_;
  std::uint64_t position_ = 0;
};

/// Describes `pixels` to OpenEXR. Their row 0 is the file's row `top`, their column 0 the file's column `left`.
Imf::FrameBuffer frame_buffer(vec4* pixels, int width, int left, int top) {
  Imf::FrameBuffer buffer;
  constexpr std::size_t pixel_bytes = sizeof(vec4);
  const std::size_t row_bytes = pixel_bytes * static_cast<std::size_t>(width);
  for (int channel = 0; channel < 4; ++channel) {
    // OpenEXR addresses by absolute pixel coordinates, so the base lies `top` rows and `left` columns before the array.
    const std::ptrdiff_t shift =
        static_cast<std::ptrdiff_t>(row_bytes) * top + static_cast<std::ptrdiff_t>(pixel_bytes) * left;
    char* base = reinterpret_cast<char*>(pixels) + sizeof(float) * static_cast<std::size_t>(channel) - shift;
    const double fill = channel == 3 ? 1 : 0;
    buffer.insert(channel_names[channel], Imf::Slice(Imf::FLOAT, base, pixel_bytes, row_bytes, 1, 1, fill));
  }
  return buffer;
}

Status check_channels(const Imf::ChannelList& channels) {
  for (int channel = 0; channel < 4; ++channel) {
    const Imf::Channel* found = channels.findChannel(channel_names[channel]);
    if (!found && channel < 3) return fail(ErrorCode::invalid_data, "no channel {}", channel_names[channel]);
    if (found && (found->xSampling != 1 || found->ySampling != 1))
      return fail(ErrorCode::unsupported, "channel {} is subsampled", channel_names[channel]);
  }
  return {};
}

}  // namespace

Result<std::string> encode_exr(const Image& image, const Provenance& provenance) try {
  Imf::Header header(image.width, image.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const char* name : channel_names) header.channels().insert(name, Imf::Channel(Imf::FLOAT));
  for (const auto& [name, value] : provenance) header.insert(name, Imf::StringAttribute(value));

  Imf::StdOSStream stream;
  {
    // The destructor writes the table of scan lines.
    Imf::OutputFile file(stream, header);
    file.setFrameBuffer(frame_buffer(const_cast<vec4*>(image.pixels.data()), image.width, 0, 0));
    file.writePixels(image.height);
  }
  return stream.str();
} catch (const std::exception& error) {
  return fail(ErrorCode::io, "cannot make an EXR file: {}", error.what());
}

Result<Image> decode_exr(const std::string& bytes) try {
  MemoryStream stream(bytes);
  Imf::InputFile file(stream);
  SPLATVOL_TRY(check_channels(file.header().channels()));
  if (!file.isComplete()) return fail(ErrorCode::invalid_data, "incomplete EXR file");

  const Imath::Box2i window = file.header().dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1;
  const std::int64_t height = std::int64_t{window.max.y} - window.min.y + 1;
  if (width < 1 || height < 1 || width > largest_side || height > largest_side)
    return fail(ErrorCode::unsupported, "{} x {} pixels", width, height);

  Image image{static_cast<int>(width), static_cast<int>(height), {}};
  image.pixels.resize(static_cast<std::size_t>(width * height));
  file.setFrameBuffer(frame_buffer(image.pixels.data(), image.width, window.min.x, window.min.y));
  file.readPixels(window.min.y, window.max.y);
  return image;
} catch (const std::bad_alloc&) {
  return fail(ErrorCode::out_of_budget, "not enough memory for the picture");
} catch (const std::exception& error) {
  return fail(ErrorCode::invalid_data, "not a readable EXR file: {}", error.what());
}

}  // namespace splatvol
