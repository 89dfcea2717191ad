// What the player asks of a desktop, where there is none: files by their names alone, and no meshes.
#include <utility>

#include "base/addresses.h"
#include "player/conversion.h"

namespace splatvol {

Result<std::unique_ptr<ByteSource>> open_file_or_url(const std::string& path_or_url) {
  if (is_url(path_or_url)) return fail(ErrorCode::unsupported, "{}: not an address of this page", path_or_url);
  return open_file(path_or_url);
}

// A mesh is then refused as any file that is no volume.
bool needs_conversion(const std::vector<std::string>& /*files*/) { return false; }

std::string usual_svbuild() { return {}; }

Result<ConvertedFile> convert(const ConversionRequest& request,
                              const std::function<void(const ConversionProgress&)>& /*tell*/,
                              const std::string& /*svbuild*/) {
  return fail(ErrorCode::unsupported, "{}: svbuild converts meshes", request.inputs.at(0));
}

format::OpenFile open_as(const std::string& /*mesh*/, const ConvertedFile& /*converted*/, format::OpenFile open) {
  return open;
}

Status forget_converted(const std::vector<std::string>& /*inputs*/, const std::string& /*svbuild*/) { return {}; }

}  // namespace splatvol
