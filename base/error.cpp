#include "base/error.h"

#include "base/printable.h"

namespace splatvol {

tl::unexpected<Error> formatted_failure(ErrorCode code, fmt::string_view format, fmt::format_args arguments) {
  return tl::unexpected<Error>(Error{code, one_line(fmt::vformat(format, arguments))});
}

tl::unexpected<Error> fail_in(const std::string& where, const Error& error) {
  return tl::unexpected<Error>(Error{error.code, one_line(where) + ": " + error.message});
}

}  // namespace splatvol
