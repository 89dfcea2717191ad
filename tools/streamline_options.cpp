#include "tools/streamline_options.h"

#include <charconv>
#include <string_view>
#include <utility>

#include "tools/tool.h"

namespace splatvol {
namespace {

std::vector<std::string_view> parts_of(std::string_view text) {
  std::vector<std::string_view> parts;
  for (std::size_t colon = 0; (colon = text.find(':')) != std::string_view::npos; text.remove_prefix(colon + 1))
    parts.push_back(text.substr(0, colon));
  parts.push_back(text);
  return parts;
}

std::optional<std::size_t> parse_count(std::string_view text) {
  std::size_t count = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
  if (error != std::errc() || end != text.data() + text.size() || count < 1 || count > most_seeds) return {};
  return count;
}

std::optional<Seeds> parse_positions(const std::vector<std::string_view>& parts) {
  std::vector<dvec3> positions;
  for (std::size_t i = 0; i < parts.size() && i < 3 && (i == 0 || i + 1 < parts.size()); ++i) {
    const auto numbers = parse_numbers(parts[i], 3);
    if (!numbers) return {};
    positions.emplace_back((*numbers)[0], (*numbers)[1], (*numbers)[2]);
  }
  if (parts.size() == 1) return positions;
  const std::string_view counts = parts.back();
  const std::size_t cross = counts.find('x');
  const auto first = parse_count(counts.substr(0, cross));
  if (parts.size() == 3 && cross == std::string_view::npos && first)
    return SeedLine{positions[0], positions[1], *first};
  const auto second = parse_count(cross == std::string_view::npos ? "" : counts.substr(cross + 1));
  if (parts.size() == 4 && first && second)
    return SeedRectangle{positions[0], positions[1], positions[2], {*first, *second}};
  return {};
}

}  // namespace

Result<Seeds> parse_seeds(const std::string& text) {
  const std::vector<std::string_view> parts = parts_of(text);
  if (const auto seeds = parse_positions(parts)) return *seeds;
  const auto count = parse_count(parts.back());
  if (parts.size() < 2 || !count || parse_numbers(parts[0], 3))
    return fail(ErrorCode::invalid_argument,
                "'{}' are no seeds, such as 0,0,0:1,0,0:20 on a line, 0,0,0:1,0,0:0,1,0:10x10 on a rectangle, or "
                "inlet:100 on a patch",
                text);
  return SeedPatch{text.substr(0, text.size() - parts.back().size() - 1), *count};
}

void add_streamline_options(CommandLine& app, StreamlineOptions& options) {
  app.add_option("--streamlines", options.vector,
                 "Write the streamlines of a vector, in the cells of the mesh, from a file that keeps them; for .vtp "
                 "and .csv: positions, the time from the seed, and the attributes. VECTOR[0], VECTOR[1] and VECTOR[2] "
                 "are attributes")
      ->check(check_not_empty)
      ->type_name("VECTOR");
  app.add_option("--seeds", options.seeds,
                 "Where streamlines begin: X,Y,Z is a position; X,Y,Z:X,Y,Z:N are N positions from end to end of a "
                 "line; X,Y,Z:X,Y,Z:X,Y,Z:NxM is the grid of a rectangle, by a corner and its two neighbours; PATCH:N "
                 "are N positions on a patch of the boundary")
      ->check(check_of(parse_seeds))
      ->type_name("SEEDS");
  app.add_option("--direction", options.direction, "Follow streamlines with the vectors, against them, or both")
      ->one_of({"forward", "backward", "both"})
      ->capture_default_str();
  app.add_option("--length", options.length,
                 "How far streamlines are followed from the seed, each way (default: five diagonals of the mesh's box)")
      ->check(check_positive)
      ->type_name("LENGTH");
  app.add_option("--steps", options.steps, "Most steps of a streamline from the seed, each way (default: 10000)")
      ->range(1, 1'000'000'000)
      ->type_name("N");
}

Result<StreamlineRequest> request_of(const StreamlineOptions& options) {
  StreamlineRequest request{.vector = options.vector};
  SPLATVOL_TRY_SET(request.seeds, parse_seeds(options.seeds));
  if (options.direction != "both")
    request.direction = options.direction == "forward" ? StreamlineDirection::forward : StreamlineDirection::backward;
  request.max_length = options.length;
  if (options.steps) request.max_steps = *options.steps;
  return request;
}

}  // namespace splatvol
