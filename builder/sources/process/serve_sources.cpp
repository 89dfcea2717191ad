#include "builder/sources/process/serve_sources.h"

#include <exception>
#include <map>
#include <memory>
#include <new>
#include <utility>

#include "base/printable.h"
#include "builder/sources/process/messages.h"
#include "builder/sources/process/opened_files.h"

namespace splatvol {
namespace {

/// Calls what may throw: libraries of formats do, and memory is limited.
template <class Call>
auto without_exceptions(const Call& call) -> decltype(call()) {
  try {
    return call();
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::out_of_budget, "reading it takes more memory than the reader process may have");
  } catch (const std::exception& error) {
    return fail(ErrorCode::invalid_data, "{}", error.what());
  }
}

/// The same. Fails also if a file was refused because it is no regular one: some libraries go on without it.
template <class Call>
auto caught(const Call& call) -> decltype(call()) {
  auto result = without_exceptions(call);
  const std::string refused = take_refused_file();
  if (!refused.empty())
    return fail(ErrorCode::invalid_data, "{}: a pipe, a device or a socket, which is not read", refused);
  return result;
}

class Server {
 public:
  Server(int socket, const ReaderLimits& limits, const OpenSource& open, const ListArrays& list,
         const ReadSurface& read_surface)
      : channel_(socket, limits.memory), open_(open), list_(list), read_surface_(read_surface) {}

  /// Answers one request. Fails when the other side is gone.
  Status answer() {
    ReaderRequest request{};
    std::uint64_t source = 0;
    SPLATVOL_TRY(channel_.get_all(request, source));
    switch (request) {
      case ReaderRequest::open:
        SPLATVOL_TRY(open(source));
        break;
      case ReaderRequest::next:
        SPLATVOL_TRY(next(*sources_.at(source)));
        break;
      case ReaderRequest::bounds:
        SPLATVOL_TRY(answer_with(caught([&] { return sources_.at(source)->bounds(); }),
                                 [&](const auto& box) { return channel_.put(box); }));
        break;
      case ReaderRequest::parts:
        SPLATVOL_TRY(channel_.put_all(false, sources_.at(source)->part_sizes()));
        break;
      case ReaderRequest::select:
        SPLATVOL_TRY(select(*sources_.at(source)));
        break;
      case ReaderRequest::close:
        sources_.erase(source);
        return {};
      case ReaderRequest::surface:
        SPLATVOL_TRY(surface());
        break;
      case ReaderRequest::list:
        SPLATVOL_TRY(list());
        break;
    }
    return channel_.flush();
  }

 private:
  Status open(std::uint64_t number) {
    std::vector<std::string> inputs;
    SourceOptions options;
    SPLATVOL_TRY(channel_.get(inputs));
    SPLATVOL_TRY(get(channel_, options));
    return answer_with(caught([&] { return open_(inputs, options); }), [&](std::unique_ptr<Source>& source) {
      sources_[number] = std::move(source);
      return put_state(*sources_[number]);
    });
  }

  Status list() {
    std::vector<std::string> inputs;
    SourceOptions options;
    SPLATVOL_TRY(channel_.get(inputs));
    SPLATVOL_TRY(get(channel_, options));
    return answer_with(caught([&] { return list_(inputs, options); }),
                       [&](const auto& arrays) { return put(channel_, arrays); });
  }

  Status next(Source& source) {
    bool lends = false, whole_cells = false;
    SPLATVOL_TRY(channel_.get_all(lends, whole_cells));
    if (lends) source.lend_values();
    if (whole_cells) source.tell_whole_cells();
    return answer_with(caught([&] { return source.next(); }), [&](std::unique_ptr<Piece>& piece) -> Status {
      SPLATVOL_TRY(put_state(source));
      SPLATVOL_TRY(channel_.put(piece != nullptr));
      return piece ? put(channel_, std::move(piece), source.attributes().size()) : Status{};
    });
  }

  Status put_state(const Source& source) {
    SourceState state = state_of(source);
    state.files = take_opened_files();
    return put(channel_, state);
  }

  Status select(Source& source) {
    std::vector<std::uint64_t> parts;
    SPLATVOL_TRY(channel_.get(parts));
    const Status selected = source.select(parts);
    return selected ? channel_.put(false) : refuse(selected.error());
  }

  Status surface() {
    std::string path;
    SPLATVOL_TRY(channel_.get(path));
    auto mesh = caught([&] { return read_surface_(path); });
    const bool named = mesh || mesh.error().message.starts_with(one_line(path));
    if (!named) return refuse(fail_in(path, mesh.error()).value());
    return answer_with(std::move(mesh), [&](const TriangleMesh& surface) { return put(channel_, surface); });
  }

  /// Sends what a call returned by `put_value`, or its failure.
  template <class T, class Put>
  Status answer_with(Result<T> result, const Put& put_value) {
    if (!result) return refuse(result.error());
    SPLATVOL_TRY(channel_.put(false));
    return put_value(*result);
  }

  Status refuse(const Error& error) {
    SPLATVOL_TRY(channel_.put(true));
    return put(channel_, error);
  }

  Channel channel_;
  const OpenSource& open_;
  const ListArrays& list_;
  const ReadSurface& read_surface_;
  std::map<std::uint64_t, std::unique_ptr<Source>> sources_;
};

}  // namespace

void serve_sources(int socket, const ReaderLimits& limits, const OpenSource& open, const ListArrays& list,
                   const ReadSurface& read_surface) {
  Server server(socket, limits, open, list, read_surface);
  while (server.answer()) {
  }
}

}  // namespace splatvol
