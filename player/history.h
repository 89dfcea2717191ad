// Undo and redo of a value.
#pragma once

#include <cstddef>
#include <deque>
#include <utility>

namespace splatvol {

/// The states that a value went through, and the present one among them.
template <class Value>
class History {
 public:
  /// Older states are forgotten.
  static constexpr std::size_t most_states = 1000;

  explicit History(Value first) { states_.push_back(std::move(first)); }

  [[nodiscard]] const Value& present() const { return states_[present_]; }
  [[nodiscard]] bool can_undo() const { return present_ > 0; }
  [[nodiscard]] bool can_redo() const { return present_ + 1 < states_.size(); }

  /// Makes `value` the present state, and forgets the states that were undone. Does nothing if it is the present one.
  void add(const Value& value) {
    if (value == present()) return;
    while (can_redo()) states_.pop_back();
    states_.push_back(value);
    if (states_.size() > most_states) states_.pop_front();
    present_ = states_.size() - 1;
  }

  /// Go to the state before or behind the present one, and return it. Stay at the first or the last one.
  const Value& undo() { return states_[can_undo() ? --present_ : present_]; }
  const Value& redo() { return states_[can_redo() ? ++present_ : present_]; }

 private:
  std::deque<Value> states_;  // from the oldest to the newest; never empty
  std::size_t present_ = 0;
};

}  // namespace splatvol
