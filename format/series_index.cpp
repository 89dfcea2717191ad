#include "format/series_index.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace splatvol::format {
namespace {

using nlohmann::ordered_json;

bool is_step(const ordered_json& step) {
  return step.is_object() && step.contains("time") && step["time"].is_number() && step.contains("file") &&
         step["file"].is_string() && std::isfinite(step["time"].get<double>());
}

}  // namespace

std::string to_json(const SeriesIndex& index) {
  ordered_json steps = ordered_json::array();
  for (const SeriesIndex::Step& step : index.steps) steps.push_back({{"time", step.time}, {"file", step.file}});
  const ordered_json document = {{"steps", steps}};
  return document.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

Result<SeriesIndex> series_index_from_json(const std::string& text) {
  const auto document = ordered_json::parse(text, nullptr, false);
  if (!document.is_object() || !document.contains("steps") || !document["steps"].is_array())
    return fail(ErrorCode::invalid_data, "not the index of a time series: no list \"steps\"");
  SeriesIndex index;
  for (const ordered_json& step : document["steps"]) {
    const std::size_t number = index.steps.size();
    if (!is_step(step)) return fail(ErrorCode::invalid_data, "step {} lacks a \"time\" or a \"file\"", number);
    index.steps.push_back({step["time"].get<double>(), step["file"].get<std::string>()});
    const std::string& file = index.steps.back().file;
    if (file.empty() || file == "." || file == ".." || file.find('/') != std::string::npos)
      return fail(ErrorCode::invalid_data, "step {}: \"{}\" is not the name of a file in the same folder", number,
                  file);
    if (number > 0 && !(index.steps[number].time > index.steps[number - 1].time))
      return fail(ErrorCode::invalid_data, "step {}: its time is not behind that of the step before", number);
  }
  if (index.steps.empty()) return fail(ErrorCode::invalid_data, "a time series without steps");
  return index;
}

}  // namespace splatvol::format
