#pragma once
#include <cstdint>
namespace std_msgs::msg { struct UInt32 { std::uint32_t data = 0; }; }
