#include "scene/color_maps.h"

#include <array>
#include <cstdint>

#include "scene/srgb.h"

namespace splatvol {
namespace {

/// Returns equally spaced control points, from sRGB codes 0xRRGGBB.
std::vector<TransferFunction::Color> spread(std::initializer_list<std::uint32_t> codes) {
  const auto linear = [](std::uint32_t code, int shift) {
    return linear_of_byte(static_cast<std::uint8_t>(code >> shift));
  };
  std::vector<TransferFunction::Color> colors;
  for (const std::uint32_t code : codes)
    colors.push_back({static_cast<double>(colors.size()) / static_cast<double>(codes.size() - 1),
                      {linear(code, 16), linear(code, 8), linear(code, 0)}});
  return colors;
}

struct Sample {
  int index;  // in the published table of 256 colours
  std::uint32_t code;
};

/// Returns control points from some colours of a table. Between them, the table is met within 4 of 255.
std::vector<TransferFunction::Color> sampled(std::initializer_list<Sample> samples) {
  std::vector<TransferFunction::Color> colors;
  for (const auto& [index, code] : samples) colors.push_back({index / 255.0, spread({code, code}).front().rgb});
  return colors;
}

}  // namespace

std::span<const ColorMap> color_maps() {
  static const std::array<ColorMap, 6> maps = {{
      {"viridis", spread({0x440154, 0x472D7B, 0x3B528B, 0x2C728E, 0x21918C, 0x28AE80, 0x5EC962, 0xADDC30, 0xFDE725})},
      {"inferno", spread({0x000004, 0x210C4A, 0x57106E, 0x8A226A, 0xBC3754, 0xE45A31, 0xF98E09, 0xF9CB35, 0xFCFFA4})},
      {"cool to warm",
       spread({0x3B4CC0, 0x6282EA, 0x8DB0FE, 0xB8D0F9, 0xDDDDDD, 0xF5C4AD, 0xF49A7B, 0xDE604D, 0xB40426})},
      {"grey", spread({0x000000, 0x404040, 0x808080, 0xBFBFBF, 0xFFFFFF})},
      {"cividis", sampled({{0, 0x00224E},
                           {14, 0x002C66},
                           {24, 0x053371},
                           {72, 0x4B546C},
                           {135, 0x838179},
                           {192, 0xBCAE6C},
                           {253, 0xFEE535},
                           {255, 0xFEE838}})},
      {"turbo", sampled({{0, 0x30123B},
                         {3, 0x341B51},
                         {12, 0x3D358B},
                         {29, 0x4664DA},
                         {45, 0x458CFD},
                         {58, 0x33ADF7},
                         {74, 0x1AD2D2},
                         {87, 0x1DE7B2},
                         {97, 0x35F394},
                         {107, 0x59FB73},
                         {120, 0x8BFF4B},
                         {132, 0xAFFA37},
                         {168, 0xF8BE39},
                         {189, 0xFC8725},
                         {205, 0xEF5811},
                         {219, 0xDA3907},
                         {236, 0xB41B01},
                         {255, 0x7A0403}})},
  }};
  return maps;
}

std::vector<TransferFunction::Color> short_cool_to_warm() {
  return {{0.00, {0.0437, 0.0723, 0.5271}},
          {0.25, {0.2664, 0.4342, 0.9911}},
          {0.50, {0.7230, 0.7230, 0.7230}},
          {0.75, {0.9047, 0.3231, 0.1981}},
          {1.00, {0.4564, 0.0012, 0.0194}}};
}

std::vector<TransferFunction::Color> reversed(std::span<const TransferFunction::Color> colors) {
  std::vector<TransferFunction::Color> result;
  for (auto color = colors.rbegin(); color != colors.rend(); ++color) result.push_back({1 - color->t, color->rgb});
  return result;
}

}  // namespace splatvol
