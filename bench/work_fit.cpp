#include "bench/work_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "player/player.h"
#include "renderer/work.h"

namespace splatvol {
namespace {

constexpr int repeats = 7;

constexpr std::array names = {"of_picture",     "of_splat", "of_fragment", "of_interpolated_pixel",
                              "of_tetrahedron", "of_row",   "of_segment"};
using Constants = std::array<double, names.size()>;

struct Measured {
  std::string picture;
  Constants counts;  // of what each constant is for
  double by_header;  // nanoseconds, as renderer/work.h estimates them
  double nanoseconds;
};

/// Returns the least time to draw several pictures, without choosing what to draw.
Result<double> least_nanoseconds(Player& player, const std::function<Status()>& draw) {
  double least = 1;
  for (int i = 0; i < repeats; ++i) {
    SPLATVOL_TRY(draw());
    least = std::min(least, player.times().frame - player.times().cut);
  }
  return 1e9 * least;
}

// Up to all points.
Status measure_splats(Player& player, const std::string& name, double pixels, std::vector<Measured>& measured) {
  for (std::uint64_t most = 64;; most *= 4) {
    for (const int spacing : {1, 2, 4}) {
      SPLATVOL_TRY(player.draw(Recipe::of_splats(most, spacing)));
      SPLATVOL_TRY_ASSIGN(nanoseconds, least_nanoseconds(player, [&] { return player.draw_again(); }));
      const auto splats = static_cast<double>(player.frame()->splats);
      const double fragments = player.times().draw.fragments;
      measured.push_back({fmt::format("{}, {} splats, samples {} apart", name, splats, spacing),
                          {1, splats, fragments, spacing > 1 ? pixels : 0, 0, 0, 0},
                          work_of_splats(splats, fragments, pixels, spacing),
                          nanoseconds});
    }
    if (player.frame()->finest) return {};
  }
}

Status measure_cells(Player& player, const std::string& name, double pixels, std::vector<Measured>& measured) {
  SPLATVOL_TRY(player.hold_cells());
  SPLATVOL_TRY_ASSIGN(estimate, player.estimate_exact());
  const auto tetrahedra = static_cast<double>(estimate.tetrahedra), segments = static_cast<double>(estimate.segments);
  for (const int spacing : {1, 2, 4, 7}) {
    const auto draw = [&]() -> Status {
      SPLATVOL_TRY(player.draw(Recipe::of_cells(spacing)));
      return {};
    };
    SPLATVOL_TRY_ASSIGN(nanoseconds, least_nanoseconds(player, draw));
    const double samples = segments / (spacing * spacing);
    measured.push_back({fmt::format("{}, {} tetrahedra, samples {} apart", name, tetrahedra, spacing),
                        {0, 0, 0, spacing > 1 ? pixels : 0, tetrahedra, std::sqrt(tetrahedra * samples),
                         estimate.segment_work * samples},
                        work_of_cells(estimate.counts(), pixels, spacing),
                        nanoseconds});
  }
  return {};
}

double estimate(const Constants& constants, const Measured& picture) {
  double sum = 0;
  for (std::size_t i = 0; i < constants.size(); ++i) sum += constants[i] * picture.counts[i];
  return sum;
}

/// Returns the constants, none below 0, with the least squares of relative errors: improves one after another, until
/// none changes.
Constants fit(const std::vector<Measured>& measured) {
  Constants constants{};
  for (int round = 0; round < 20000; ++round)
    for (std::size_t i = 0; i < constants.size(); ++i) {
      double slope = 0, curve = 0;
      for (const Measured& picture : measured) {
        const double share = picture.counts[i] / picture.nanoseconds;
        slope += share * (1 - estimate(constants, picture) / picture.nanoseconds);
        curve += share * share;
      }
      if (curve > 0) constants[i] = std::max(0.0, constants[i] + slope / curve);
    }
  return constants;
}

/// Prints how far estimates are off: `estimated` over measured.
void print_ratios(const char* whose, const std::vector<Measured>& measured,
                  const std::function<double(const Measured&)>& estimated) {
  const auto off = [&](const Measured& picture) {
    return std::abs(std::log(estimated(picture) / picture.nanoseconds));
  };
  double sum = 0;
  for (const Measured& picture : measured) sum += off(picture);
  const Measured& worst = *std::ranges::max_element(measured, {}, off);
  fmt::print(
      "{}: a factor of {:.2f} off in the geometric mean of {} pictures, at worst {:.0f} instead of {:.0f} us: {}\n",
      whose, std::exp(sum / static_cast<double>(measured.size())), measured.size(), 1e-3 * estimated(worst),
      1e-3 * worst.nanoseconds, worst.picture);
}

}  // namespace

Status fit_work(std::span<const char* const> arguments) {
  std::vector<Measured> measured;
  for (std::size_t i = 0; i + 1 < arguments.size(); i += 2) {
    SPLATVOL_TRY_ASSIGN(scene, load_scene(arguments[i + 1]));
    SPLATVOL_TRY_ASSIGN(player,
                        Player::open(arguments[i], scene, {.memory = std::uint64_t{8} << 30, .device = Device::cpu}));
    for (const int part : {2, 1}) {
      Scene sized = scene;
      sized.width /= part, sized.height /= part;
      SPLATVOL_TRY(player->set_scene(sized));
      const std::string name = fmt::format("{}, {} x {}", arguments[i + 1], sized.width, sized.height);
      const double pixels = static_cast<double>(sized.width) * sized.height;
      SPLATVOL_TRY(measure_splats(*player, name, pixels, measured));
      if (player->has_cells()) SPLATVOL_TRY(measure_cells(*player, name, pixels, measured));
    }
  }
  if (measured.empty()) return fail(ErrorCode::invalid_argument, "no file and scene to draw");
  const Constants fitted = fit(measured);
  for (std::size_t i = 0; i < fitted.size(); ++i)
    fmt::print("inline constexpr double {} = {:.3g};\n", names[i], fitted[i]);
  print_ratios("fitted", measured, [&](const Measured& picture) { return estimate(fitted, picture); });
  print_ratios("renderer/work.h", measured, [](const Measured& picture) { return picture.by_header; });
  return {};
}

}  // namespace splatvol
