//! Colour spaces: sRGB, linear light and CIE L*a*b*.
