#include "builder/sources/reader_error.h"

#include <new>

namespace splatvol {

std::optional<std::string> describe_exception(const std::exception& exception) {
  if (const auto* error = dynamic_cast<const ReaderError*>(&exception)) return error->what();
  if (dynamic_cast<const std::bad_alloc*>(&exception))
    return "not enough memory for what it states: the file is damaged, or must be written in pieces";
  return std::nullopt;
}

Status run_reader(const std::string& path, const std::function<void()>& call) {
  try {
    call();
    return {};
  } catch (const std::exception& exception) {
    const auto known = describe_exception(exception);
    return fail(ErrorCode::invalid_data, "{}: {}", path,
                known ? *known : fmt::format("the file is damaged ({})", exception.what()));
  }
}

}  // namespace splatvol
