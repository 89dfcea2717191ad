// Long calls: without the GIL, ended by Ctrl-C.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace splatvol::python {

/// Takes the progress of a call from its threads to the thread of Python that waits for it. Thread-safe.
class ProgressBox {
 public:
  using Entry = std::pair<std::string, double>;  // stage, share of it

  void put(const std::string& stage, double share);

  /// Returns what was put since the last call: the last share of each stage.
  [[nodiscard]] std::vector<Entry> take();

 private:
  std::mutex mutex_;
  std::vector<Entry> entries_;
};

/// Functions that run while a call lasts.
struct WhileCalling {
  std::function<void()> cancel = {};  // any thread; until the call ends, again and again
  std::function<void()> look = {};    // with the GIL, each 50 ms and after the call; may throw
};

/// Runs `call` on a thread of its own, without the GIL, under an Interruptible (base/interruption.h). If a signal
/// handler of Python raises (Ctrl-C), or `look` throws, the call is cancelled; once it has ended, this throws the same.
/// Needs the GIL, which other threads of Python have meanwhile.
void run_interruptibly(const std::function<void()>& call, const WhileCalling& meanwhile = {});

/// The same for a call that returns a value.
template <class Call>
auto call_interruptibly(Call call, const WhileCalling& meanwhile = {}) {
  std::optional<decltype(call())> result;
  run_interruptibly([&] { result.emplace(call()); }, meanwhile);
  return std::move(*result);
}

}  // namespace splatvol::python
