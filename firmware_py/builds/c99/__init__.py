"""The firmware as C99: its functions under their own names, translated from syntax trees and type hints."""
