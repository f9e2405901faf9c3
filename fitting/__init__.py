"""Compensation models: arrays in, parameters out."""
