// Parts of a file that were used last.
#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <utility>

namespace splatvol::format {

/// Items that are kept until others of so many bytes have been used after them. Not thread-safe.
template <class Key, class Item>
class LastUsed {
 public:
  /// Returns null if the item is not held.
  Item* find(const Key& key) {
    const auto found = items_.find(key);
    if (found == items_.end()) return nullptr;
    order_.splice(order_.begin(), order_, found->second.at);
    return &found->second.item;
  }

  /// Adds an item of `bytes`, if others use at most `memory` with it: those that were used first go. It stays until
  /// then.
  Item& add(const Key& key, Item item, std::uint64_t bytes, std::uint64_t memory) {
    while (!order_.empty() && held_ + bytes > memory) {
      held_ -= items_.at(order_.back()).bytes;
      items_.erase(order_.back());
      order_.pop_back();
    }
    order_.push_front(key);
    held_ += bytes;
    return items_.emplace(key, Entry{std::move(item), bytes, order_.begin()}).first->second.item;
  }

 private:
  struct Entry {
    Item item;
    std::uint64_t bytes;
    typename std::list<Key>::iterator at;
  };
  std::list<Key> order_;  // last used first
  std::map<Key, Entry> items_;
  std::uint64_t held_ = 0;
};

}  // namespace splatvol::format
